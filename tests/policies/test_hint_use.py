from dataclasses import replace

import numpy as np
import pytest
import torch

from ocplanner import Demonstrations, Policy
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError
from ocplanner.files.records.render import RenderRecord
from ocplanner.policies.hint_use import HintUse, hint_use, mean_share
from ocplanner.policies.observation import Observation
from random_policy import HELD, random_training, write_labelled, write_random_policy


@pytest.fixture
def labelled(tiny_square, tmp_path):
    return lambda **options: write_labelled(tiny_square(images=True), tmp_path / "labelled.hdf5", **options)


def loaded(tmp_path, data, *settings) -> Policy:
    return Policy.load(write_random_policy(tmp_path / "policy.safetensors", data, random_training(*settings)))


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
@pytest.mark.parametrize("horizons", [(5,), (1, 10)])
def test_the_parts_make_up_what_the_policy_would_do(labelled, tmp_path, algorithm, horizons):
    """Against :meth:`Policy.act` step by step, as in a rollout: a likely action lies at a mode's mean."""
    data = labelled(horizons=horizons)
    policy = loaded(tmp_path, data, algorithm, horizons, ("agentview",))
    with torch.no_grad():  # one mode by far the likeliest, so that acting always draws it
        policy.network.head.linear.bias[-1] = 60
    with Demonstrations(data) as demos:
        use = hint_use(policy, demos, "demo_2")
        recorded = {key: demos["demo_2"].observation(key) for key in policy.observation_keys if "_image" not in key}
        recorded["agentview_image"] = demos["demo_2"].images("agentview")
    policy.reset(0)
    acted = np.concatenate([policy.act({key: array[[t]] for key, array in recorded.items()}) for t in range(90)])
    mean = use.residual.copy()
    mean[:, :6] += use.moved.reshape(-1, 6)
    np.testing.assert_allclose(np.clip(mean, -1, 1), acted, atol=1e-3)
    assert use.weights.shape == (90, len(horizons), 2)
    assert use.horizons == horizons
    np.testing.assert_allclose(use.probability, 1)
    np.testing.assert_array_equal(np.flatnonzero(use.held), np.arange(90)[HELD])
    assert (use.moved[~use.held] == 0).all()


def test_the_likeliest_mode_is_taken(labelled, tmp_path):
    data = labelled()
    policy = loaded(tmp_path, data)
    modes = policy.training.network.gmm.modes
    with torch.no_grad():  # the modes take turns
        policy.network.head.linear.bias[-modes:] = 0
        policy.network.head.linear.weight[-modes:] = 20 * torch.randn(modes, 32)
    with Demonstrations(data) as demos:
        use = hint_use(policy, demos, "demo_0")
        demo = demos["demo_0"]
        keys = policy.training.observation.low_dim
        numbers = np.concatenate([demo.observation(key) for key in keys], axis=1).astype(np.float32)
        hint = torch.from_numpy(demo.observation("ocp_hint"))
    with torch.no_grad():
        mixture, _ = policy.network.distribution(Observation(torch.from_numpy(numbers), {}, hint))
    mode = mixture.logits.argmax(dim=-1).numpy()
    assert len(set(mode)) > 1
    np.testing.assert_allclose(use.probability, mixture.logits.softmax(dim=-1).max(dim=-1).values.numpy(), rtol=1e-5)
    mean = mixture.means.numpy()[np.arange(90), mode]
    np.testing.assert_allclose(mean[:, :6] - use.moved.reshape(-1, 6), use.residual[:, :6], atol=1e-6)


def use_of(weights: tuple[float, float], residual: float) -> HintUse:
    """Two steps, held at the second; a hint of 0.5 along x and about z."""
    hint = np.zeros((2, 1, 2, 3))
    hint[1, 0, 0, 0] = hint[1, 0, 1, 2] = 0.5
    part = np.full((2, 7), 0.0)
    part[:, 0] = residual
    return HintUse("demo_0", (1,), np.array([False, True]), hint, np.full((2, 1, 2), weights), part, np.ones(2))


def test_the_share_is_the_hints_part_of_the_motion_while_held():
    np.testing.assert_allclose(use_of((1, 1), 0).share, [1, 1])
    np.testing.assert_allclose(use_of((0, 1), 0.5).share, [0, 1])
    np.testing.assert_allclose(use_of((1, 0.2), 0.5).share, [0.5, 1])
    assert np.isnan(use_of((1, 0), 0.5).share[1])  # nothing turns
    together = mean_share([use_of((1, 1), 0), use_of((1, 1), 0), use_of((0, 1), 1)])
    np.testing.assert_allclose(together, [1 / 3, 1])
    np.testing.assert_allclose(use_of((1, 1), 0.5).residual_size, [[0.5, 0], [0.5, 0]])


def test_what_does_not_fit_is_refused(labelled, tiny_square, tmp_path):
    data = labelled()
    hinted = loaded(tmp_path, data)
    with Demonstrations(data) as demos:
        with pytest.raises(DatasetError, match="no such demonstration"):
            hint_use(hinted, demos, "demo_7")
        with pytest.raises(InvalidValueError, match="reads no hint"):
            hint_use(loaded(tmp_path, data, "bc", None), demos, "demo_0")
    with Demonstrations(tiny_square()) as plain, pytest.raises(MismatchError, match="no hints on record"):
        hint_use(hinted, plain, "demo_0")
    for other in ({"horizons": (1,)}, {"planner": "cd" * 32}):
        with (
            Demonstrations(labelled(**other)) as demos,
            pytest.raises(MismatchError, match=r"hints 5 steps ahead from"),
        ):
            hint_use(hinted, demos, "demo_0")


def test_pictures_of_another_observation_are_refused(labelled, tmp_path):
    data = labelled()
    policy = loaded(tmp_path, data, "bc", (5,), ("agentview",))
    policy.header = replace(policy.header, render=RenderRecord("masked"))
    with Demonstrations(data) as demos, pytest.raises(MismatchError, match="shows observe=full"):
        hint_use(policy, demos, "demo_0")
