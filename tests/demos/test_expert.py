import numpy as np
import pytest

from ocplanner.demos.expert import Manner, advance, carry_path, expert_of
from ocplanner.errors import UnknownNameError


@pytest.mark.parametrize("seed", range(5))
def test_path_leads_up_over_and_to_the_goal_in_even_steps(seed):
    manner = Manner.draw(np.random.default_rng(seed))
    start, goal = np.array([-0.11, 0.15, 0.83]), np.array([0.23, 0.1, manner.carry_height])
    path = carry_path(start, goal, manner)
    assert path[0] == pytest.approx(start)
    assert path[-1] == pytest.approx(goal)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert steps.max() < 1.2 * steps.min()
    near_peg = path[np.linalg.norm(path[:, :2] - goal[:2], axis=1) < 0.06]
    assert near_peg[:, 2].min() > 0.965  # above the peg's top


def test_advance_never_goes_back():
    path = np.stack([np.linspace(0, 1, 51), np.zeros(51), np.zeros(51)], axis=1)
    place = advance(path, 0, np.zeros(3), 0.1)
    assert path[place, 0] == pytest.approx(0.08)
    assert advance(path, place, np.array([-1.0, 0, 0]), 0.1) == place


def test_unknown_task():
    with pytest.raises(UnknownNameError, match="Square"):
        expert_of("ToolHang")
