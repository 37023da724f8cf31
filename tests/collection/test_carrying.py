from dataclasses import replace

import numpy as np
import pytest

from ocplanner.collection.carrying import DemonstrationVariation, advance, carry_path, evenly_spaced, turned
from ocplanner.collection.experts import expert_of
from ocplanner.geometry.rotation import angle_between, yaw_rotation

PLAIN = DemonstrationVariation(
    carry_height=1.0, sideways=0.0, lookahead=0.03, release_height=0.9, lowering=0.01, yaw_error=0.0, noise=0.0
)


@pytest.mark.parametrize("seed", range(5))
def test_path_leads_up_over_and_to_the_goal_in_even_steps(seed):
    variation = expert_of("Square").draw_variation(np.random.default_rng(seed))
    start, goal = np.array([-0.11, 0.15, 0.83]), np.array([0.23, 0.1, variation.carry_height])
    path = carry_path(start, goal, variation)
    assert path[0] == pytest.approx(start)
    assert path[-1] == pytest.approx(goal)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() < 1.2 * steps.min()
    near_peg = path[np.linalg.norm(path[:, :2] - goal[:2], axis=1) < 0.06]
    assert near_peg[:, 2].min() > 0.965  # above the peg's top


def test_path_bows_to_the_left_of_the_way():
    start, goal = np.array([0.0, 0.0, 0.8]), np.array([0.3, 0.0, 1.0])
    straight, left, right = (
        carry_path(start, goal, replace(PLAIN, sideways=sideways))[:, 1] for sideways in (0.0, 0.05, -0.05)
    )
    assert np.abs(straight).max() < 1e-12
    assert 0.02 < left.max() < 0.05
    np.testing.assert_allclose(right, -left, atol=1e-12)


def test_evenly_spaced_keeps_the_curve():
    s = np.linspace(0.0, 1.0, 400)[:, None] ** 3
    points = evenly_spaced(np.hstack([np.cos(s), np.sin(s), 0 * s]), 21)
    np.testing.assert_allclose(points[:, 0], np.cos(np.linspace(0, 1, 21)), atol=1e-4)


def test_advance_never_goes_back():
    path = np.stack([np.linspace(0, 1, 51), np.zeros(51), np.zeros(51)], axis=1)
    place = advance(path, 0, np.zeros(3), 0.1)
    assert path[place, 0] == pytest.approx(0.08)
    assert advance(path, place, np.array([-1.0, 0, 0]), 0.1) == place


def test_turned_goes_the_short_way():
    start, goal = yaw_rotation(3.0), yaw_rotation(-3.0)
    half = turned(start, goal, 0.5)
    assert angle_between(half, start) == pytest.approx(angle_between(half, goal))
    assert angle_between(half, yaw_rotation(np.pi)) < 1e-9


def test_scaling_leaves_no_noise_at_zero_and_everything_at_one():
    variation = replace(PLAIN, sideways=0.02, yaw_error=0.1, noise=0.05)
    assert variation.scaled(0.0) == PLAIN
    assert variation.scaled(1.0) == variation
