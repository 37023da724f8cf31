from dataclasses import replace

import numpy as np
import pytest
import torch

from ocplanner.policies.config import preset
from ocplanner.policies.network import make_network
from ocplanner.policies.observation import Observation, cropped

SHAPES = {"bc": (6,), "bc-rnn": (5, 6)}


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
@pytest.mark.parametrize("cameras", [(), ("agentview", "robot0_eye_in_hand")])
def test_shapes(small, observe, algorithm, cameras):
    actor = make_network(small(algorithm, hint=(1, 5), cameras=cameras), 23, 7)
    seen = observe(SHAPES[algorithm], 13, cameras)
    mixture, _ = actor.distribution(seen)
    assert mixture.means.shape == mixture.stds.shape == (*SHAPES[algorithm], 5, 7)
    assert mixture.logits.shape == (*SHAPES[algorithm], 5)
    assert actor(seen, torch.zeros(*SHAPES[algorithm], 7)).shape == ()


@pytest.mark.parametrize("algorithm", ["bc", "bc-rnn"])
def test_a_tiny_batch_is_learned_by_heart(small, observe, algorithm):
    config = small(algorithm)
    actor = make_network(replace(config, network=replace(config.network, lstm_hidden=64)), 23, 7)
    seen, actions = observe(SHAPES[algorithm]), torch.rand(*SHAPES[algorithm], 7) * 1.8 - 0.9
    optimiser = torch.optim.Adam(actor.parameters(), lr=5e-3)
    slower = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.01, total_iters=1000)
    for _ in range(1000):
        optimiser.zero_grad()
        loss = actor(seen, actions)
        loss.backward()
        optimiser.step()
        slower.step()
    drawn = actor.distribution(seen)[0].sample(low_noise=True, generator=torch.Generator().manual_seed(0))
    assert loss < -7
    assert (drawn - actions).abs().median() < 0.01  # a mode that explains one target need not be sharp in every number


def test_an_lstm_step_by_step_is_the_sequence_at_once(small, observe):
    actor = make_network(small("bc-rnn"), 23, 7)
    seen, memory = observe((5, 6)), None
    whole, _ = actor.distribution(seen)
    for t in range(5):
        step, memory = actor.distribution(Observation(seen.low_dim[t : t + 1], {}, None), memory)
        torch.testing.assert_close(step.means[0], whole.means[t])


@pytest.mark.parametrize(
    ("algorithm", "count"),
    [
        ("bc", 23 * 1024 + 1024 + 1024 * 1024 + 1024 + 1025 * 75),
        ("bc-rnn", 1600 * (23 + 400 + 2) + 1600 * (400 + 400 + 2) + 401 * 75),
    ],
)
def test_the_published_networks_have_robomimics_number_of_parameters(algorithm, count):
    actor = make_network(preset("robomimic", algorithm), 23, 7)
    assert sum(parameter.numel() for parameter in actor.parameters()) == count


def test_the_seed_decides_the_first_weights_and_leaves_torchs_alone(small):
    before = torch.random.get_rng_state()
    first, same, other = (make_network(small(seed=seed), 23, 7).state_dict() for seed in (0, 0, 1))
    assert all(torch.equal(first[name], same[name]) for name in first)
    assert not torch.equal(first["head.linear.weight"], other["head.linear.weight"])
    assert torch.equal(before, torch.random.get_rng_state())


def test_numbers_are_standardised_by_the_training_data(small):
    config = small()
    numbers = torch.randn(500, 23) * 7 + 100
    numbers[:, 3] = 0.5
    seen = Observation(numbers, {}, None)
    encoder = make_network(config, 23, 7).encoder
    encoder.fit(numbers)
    encoded = encoder(seen)
    torch.testing.assert_close(encoded.mean(0), torch.zeros(23), rtol=0, atol=1e-4)
    torch.testing.assert_close(encoded[:, :3].std(0, correction=0), torch.ones(3), rtol=1e-4, atol=0)
    assert torch.equal(encoded[:, 3], torch.zeros(500))
    plain = make_network(replace(config, observation=replace(config.observation, normalise=False)), 23, 7).encoder
    plain.fit(numbers)
    assert torch.equal(plain(seen), numbers)


def test_crops_are_windows_of_the_picture():
    images = np.random.default_rng(0).integers(0, 256, (2, 3, 84, 84, 3), dtype=np.uint8)
    central = cropped(images, 76, None)
    assert central.shape == (2, 3, 3, 76, 76)
    torch.testing.assert_close(central[1, 2], torch.from_numpy(images[1, 2, 4:80, 4:80]).permute(2, 0, 1) / 255)
    random = cropped(images, 76, np.random.default_rng(1))
    places = set()
    for picture, cut in zip(images.reshape(6, 84, 84, 3), random.flatten(0, 1)):
        wanted = (cut.permute(1, 2, 0) * 255).round().byte().numpy()
        found = [(y, x) for y in range(9) for x in range(9) if np.array_equal(picture[y : y + 76, x : x + 76], wanted)]
        assert len(found) == 1
        places.add(found[0])
    assert len(places) > 2
