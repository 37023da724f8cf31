import numpy as np
import pytest

from ocplanner.collection.attempts import attempt
from ocplanner.collection.experts import expert_of, experts
from ocplanner.collection.experts.lift import bowed_path
from ocplanner.envs.environment import make_env
from ocplanner.envs.tasks import tasks
from ocplanner.errors import UnknownNameError

DEVELOPMENT_SEEDS = (500, 501, 502)


def test_experts_are_found_by_being_there():
    assert {"Lift", "Can", "Square"} <= set(experts()) <= set(tasks())
    for name, expert in experts().items():
        assert expert.task == name
        assert expert_of(name) is expert


def test_unknown_task_lists_the_known():
    with pytest.raises(UnknownNameError, match="Square"):
        expert_of("Juggling")


@pytest.mark.parametrize("name", sorted(experts()))
def test_variations_differ_with_the_seed_alone(name):
    draw = expert_of(name).draw_variation
    first, again, other = (draw(np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert first == again != other


@pytest.mark.parametrize("name", sorted(experts()))
def test_solves_its_task(name):
    with make_env(name, cameras=()) as env:
        solved = [attempt(env, seed, lambda action: None) for seed in DEVELOPMENT_SEEDS]
    assert sum(solved) >= len(solved) - 1


def test_noise_is_on_demand():
    """Without it the cube goes straight up; with it, somewhere else each time."""
    with make_env("Lift", cameras=()) as env:

        def widest(seed, noise):
            way = []
            assert attempt(env, seed, lambda action: way.append(env.object_pose().position), noise=noise)
            raised = np.array([place for place in way if place[2] > way[0][2] + 0.005])
            return np.abs(raised[:, :2] - raised[0, :2]).max()

        assert [widest(seed, 0.0) < 0.004 for seed in DEVELOPMENT_SEEDS] == [True] * 3
        assert max(widest(seed, 1.0) for seed in DEVELOPMENT_SEEDS) > 0.01


def test_the_cube_is_lifted_in_a_bow():
    variation = expert_of("Lift").draw_variation(np.random.default_rng(0))
    start = np.array([0.02, -0.01, 0.85])
    path = bowed_path(start, variation)
    assert path[0] == pytest.approx(start)
    assert path[-1] == pytest.approx([*start[:2], variation.carry_height])
    assert np.abs(path[:, 1] - start[1]).max() == pytest.approx(abs(variation.sideways), rel=0.01)
    assert np.ptp(path[:, 0]) == 0
