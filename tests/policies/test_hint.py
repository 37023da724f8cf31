from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.errors import MismatchError, ShapeError
from ocplanner.policies.config import HINT_KEY, HintConfig
from ocplanner.policies.gmm import Mixture
from ocplanner.policies.hint import HintWeights, displacements, residual_motion
from ocplanner.policies.network import make_network

SHAPES = {"bc": (6,), "bc-rnn": (5, 6)}


def zeroed(seen):
    return seen._replace(hint=torch.zeros_like(seen.hint))


def switched_off(seen):
    hint = seen.hint.clone()
    hint[..., -1] = 0
    return seen._replace(hint=hint)


@pytest.mark.parametrize("off", [zeroed, switched_off])
@pytest.mark.parametrize("horizons", [(1,), (1, 5, 10)])
@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_without_a_hint_the_network_is_the_plain_algorithm_number_for_number(small, observe, algorithm, horizons, off):
    hinted, plain = (make_network(small(algorithm, hint), 23, 7) for hint in (horizons, None))
    seen = off(observe(SHAPES[algorithm], 6 * len(horizons) + 1))
    actions = torch.rand(*SHAPES[algorithm], 7)
    optimisers = [torch.optim.Adam(actor.parameters(), lr=1e-3) for actor in (hinted, plain)]
    for _ in range(3):
        for actor, optimiser in zip((hinted, plain), optimisers):
            optimiser.zero_grad()
            actor(seen, actions).backward()
            optimiser.step()
        (ours, _), (theirs, _) = (actor.distribution(seen) for actor in (hinted, plain))
        assert all(torch.equal(getattr(ours, part), getattr(theirs, part)) for part in ("logits", "means", "stds"))
    weights = hinted.state_dict()
    assert all(torch.equal(weights[name], value) for name, value in plain.state_dict().items())


@given(st.integers(1, 4), st.integers(1, 5), st.integers(0, 2**31))
def test_weights_of_one_and_no_residual_give_the_hint_itself(count, modes, seed):
    torch.manual_seed(seed)
    head = HintWeights(8, modes, HintConfig(tuple(range(1, count + 1)), initial_weight=0.0))
    hint = torch.cat([torch.randn(3, 6 * count), torch.ones(3, 1)], dim=-1)
    with torch.no_grad():
        head.linear.weight.zero_()
        head.linear.bias.zero_()
        head.linear.bias.unflatten(0, (modes, count, 2))[:, 0] = 1  # x = y = 1 at the first k, 0 at the others
    nothing = Mixture(torch.zeros(3, modes), torch.zeros(3, modes, 7), torch.ones(3, modes, 7))
    means = head(nothing, torch.randn(3, 8), hint).means
    expected = torch.nn.functional.pad(hint[:, :6], (0, 1))[:, None].expand(-1, modes, -1)
    assert torch.equal(means, expected)


def test_x_scales_the_position_and_y_the_rotation_of_every_k_and_mode():
    head = HintWeights(4, 2, HintConfig((1, 5)))
    features, hint = torch.randn(9, 4), torch.cat([torch.randn(9, 12), torch.ones(9, 1)], dim=-1)
    residual = Mixture(torch.randn(9, 2), torch.randn(9, 2, 7), torch.rand(9, 2, 7))
    result = head(residual, features, hint)
    x, y = head.weights(features).unbind(-1)  # each (9, modes, K)
    for mode in range(2):
        expected = residual.means[:, mode].clone()
        for k in range(2):
            expected[:, :3] += x[:, mode, k, None] * hint[:, 6 * k : 6 * k + 3]
            expected[:, 3:6] += y[:, mode, k, None] * hint[:, 6 * k + 3 : 6 * k + 6]
        torch.testing.assert_close(result.means[:, mode], expected)
    assert torch.equal(result.means[..., 6], residual.means[..., 6])
    assert torch.equal(result.stds, residual.stds)


def test_a_hint_that_is_off_may_hold_anything():
    hint = torch.tensor([[float("nan")] * 6 + [0.0], [float("inf")] * 6 + [0.0]])
    assert torch.equal(displacements(hint, HintConfig((1,))), torch.zeros(2, 1, 2, 3))


def test_another_width_is_refused():
    with pytest.raises(ShapeError, match=r"7 numbers, expected 13 for horizons \(1, 5\)"):
        displacements(torch.zeros(2, 7), HintConfig((1, 5)))


def test_a_missing_hint_is_refused(small, observe):
    with pytest.raises(MismatchError, match="ocp_hint"):
        make_network(small(hint=(1,)), 23, 7).distribution(observe((4,)))


def test_the_weights_start_where_the_configuration_says(small, observe):
    config = small(hint=(1,))
    network = replace(config.network, hint=HintConfig((1,), initial_weight=3.0))
    ones, threes = (make_network(replace(config, network=n), 23, 7).hint for n in (config.network, network))
    features = torch.randn(5, 32)
    torch.testing.assert_close(threes.weights(features) - ones.weights(features), torch.full((5, 5, 1, 2), 2.0))


def test_the_residuals_motion_counts_by_probability_and_only_while_held():
    residual = Mixture(torch.tensor([[0.0, 0.0], [9.0, -9.0]]), torch.zeros(2, 2, 7), torch.ones(2, 2, 7))
    residual.means[:, 0, :3] = 2.0
    residual.means[:, 1, 6] = 5.0  # the gripper is the residual's alone
    hint = torch.zeros(2, 7)
    hint[:, -1] = torch.tensor([1.0, 0.0])
    assert residual_motion(residual, hint) == pytest.approx(0.5 * 12 / 2)  # one step of two, one mode of two
    hint[:, -1] = torch.tensor([0.0, 1.0])
    assert residual_motion(residual, hint) == pytest.approx(12 / 2, rel=1e-5)


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_the_penalty_is_in_the_loss_of_training_alone(small, observe, algorithm):
    shape = (5, 6) if algorithm == "bc-rnn" else (6,)
    seen, actions = observe(shape, 7), torch.zeros(*shape, 7)
    losses = {}
    for penalty in (0.0, 2.0):
        config = small(algorithm, hint=(1,))
        hint = HintConfig((1,), residual_penalty=penalty)
        actor = make_network(replace(config, network=replace(config.network, hint=hint)), 23, 7)
        features, _ = actor.features(actor.encoder(seen), None)
        motion = residual_motion(actor.head(features), seen.hint)
        losses[penalty] = actor.train()(seen, actions), actor.eval()(seen, actions)
    torch.testing.assert_close(losses[2.0][0], losses[0.0][0] + 2 * motion)
    assert motion > 0
    assert losses[2.0][1] == losses[0.0][1]


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
@pytest.mark.parametrize("training", [True, False])
def test_the_plan_stands_for_the_pictures_while_the_object_is_held(small, observe, algorithm, training):
    config = small(algorithm, hint=(1,), cameras=("agentview",))
    hint = replace(config.network.hint, instead_of_pictures=True)
    reading = replace(config.observation, low_dim=(*config.observation.low_dim, HINT_KEY))
    actor = make_network(replace(config, observation=reading, network=replace(config.network, hint=hint)), 23, 7).train(
        training
    )
    seen = observe(SHAPES[algorithm], 7, cameras=("agentview",))
    held = torch.zeros(SHAPES[algorithm], dtype=torch.bool)
    held[2:4] = True
    seen.hint[..., -1] = held.float()
    others = {
        "agentview": torch.where(held[..., None, None, None], 1 - seen.images["agentview"], seen.images["agentview"])
    }
    features = actor.encoder(seen, held)
    assert (features[held][:, -8:] == 0).all()
    assert (features[~held][:, -8:] != 0).any(dim=-1).all()
    torch.testing.assert_close(actor.encoder(seen._replace(images=others), held), features)
    if not training:  # in training the statistics are of the pictures that are seen
        torch.testing.assert_close(features[~held], actor.encoder(seen)[~held])
    all_held = seen._replace(hint=torch.ones_like(seen.hint))
    assert actor(all_held, torch.zeros(*SHAPES[algorithm], 7)).isfinite()


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_a_hint_that_steers_moves_by_itself_while_the_object_is_held(small, observe, algorithm):
    config = small(algorithm, hint=(1,))
    plain = make_network(config, 23, 7)
    hint = HintConfig((1,), initial_weight=0.5, steers=True)
    steered = make_network(replace(config, network=replace(config.network, hint=hint)), 23, 7)
    assert not any("linear" in name for name, _ in steered.hint.named_parameters())
    seen = observe(SHAPES[algorithm], 7)
    seen.hint[..., -1] = 0
    free, _ = plain.distribution(seen)
    torch.testing.assert_close(steered.distribution(seen)[0].means, free.means)
    seen.hint[..., -1] = 1
    means = steered.distribution(seen)[0].means
    torch.testing.assert_close(means[..., :6], (0.5 * seen.hint[..., None, :6]).expand_as(means[..., :6]))
    torch.testing.assert_close(means[..., 6], free.means[..., 6])
