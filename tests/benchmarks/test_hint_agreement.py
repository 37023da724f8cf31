import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))


from hint_agreement import agreement, agreements

from ocplanner.planner.planner import Planner
from ocplanner.rewards import LabelSettings, label_dataset
from random_planner import write_random_planner


def test_a_hint_that_is_a_third_of_the_action():
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 6))
    found = agreement(actions / 3, actions)
    for values, expected in zip(found[:3], (1, 3, 1)):
        np.testing.assert_allclose(values, expected)
    np.testing.assert_allclose(3 * found.hint, found.action)


def test_a_hint_that_says_nothing_and_one_of_the_wrong_sign():
    rng = np.random.default_rng(0)
    actions, noise = rng.uniform(-1, 1, (2, 4000, 6))
    assert np.abs(agreement(noise, actions).correlation).max() < 0.1
    assert agreement(noise, actions).explained.max() < 0.01
    np.testing.assert_allclose(agreement(-actions, actions).weight, -1)


def test_reads_a_labelled_data_set(tiny_square, tmp_path):
    write_random_planner(tmp_path / "p.safetensors", observe="full", visual=None, mask_rgb=None)
    path = label_dataset(
        tiny_square("1.4.1", images=True),
        tmp_path / "out.hdf5",
        Planner.load(tmp_path / "p.safetensors"),
        LabelSettings(horizon_steps=(2, 3)),
    )
    found = agreements(path, "valid")
    assert list(found) == [2, 3]
    assert found[2].action[2] > 0.01
    assert np.isnan(found[2].correlation[3:]).all()  # the synthetic hand is never told to turn
