from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocplanner.errors import InvalidValueError, MismatchError, ShapeError
from ocplanner.guidance.labelling import label_demonstration
from ocplanner.guidance.rewards import plan_reward
from ocplanner.guidance.settings import FORMS, RewardConfig
from ocplanner.planner.planner import Planner
from random_planner import random_images, write_random_planner

STEPS = 40
GRASPING = np.zeros(STEPS, bool)
GRASPING[[3, *range(7, 30), 38, 39]] = True


def demonstration(steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    position = np.array([0.1, 0.05, 0.95]) + 0.05 * rng.standard_normal((steps + 1, 3))
    return position, Rotation.from_rotvec(0.3 * rng.standard_normal((steps + 1, 3))).as_matrix()


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Planner:
    path: Path = tmp_path_factory.mktemp("planner") / "p.safetensors"
    write_random_planner(path, cameras=["agentview", "side"], modes=2, horizon=6)
    return Planner.load(path)


@pytest.fixture(scope="module")
def images(planner: Planner) -> dict[str, np.ndarray]:
    return random_images(dict(planner.config), STEPS)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("threads", [1, 3])
def test_agrees_with_planning_first(planner, images, form, terminal, threads):
    config = RewardConfig(1.0, 0.5, form=form, scale=2.0)
    position, rotation = demonstration()
    found = label_demonstration(
        planner, images, (position, rotation), GRASPING, config, terminal=terminal, threads=threads
    )
    plan = planner.plan(images)
    first = (plan.position[:, 0], plan.rotation[:, 0])
    expected = plan_reward(first, (position[1:], rotation[1:]), GRASPING, config, terminal=terminal)
    assert np.all(expected.position[GRASPING] > 0)
    for a, b in zip(found, expected):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-5)  # float32 plans in batches of another size


@pytest.mark.parametrize("step", [1, 5])
def test_a_later_step_is_compared_when_it_is_due(planner, images, step):
    position, rotation = demonstration()
    found = label_demonstration(planner, images, (position, rotation), GRASPING, step=step)
    plan = planner.plan(images)
    due = [min(t + 1 + step, STEPS) for t in range(STEPS)]
    later = (plan.position[:, step], plan.rotation[:, step])
    expected = plan_reward(later, (position[due], rotation[due]), GRASPING)
    np.testing.assert_allclose(found.position, expected.position, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.rotation, expected.rotation, rtol=0, atol=1e-5)


def test_the_plan_itself_is_best(planner, images):
    plan = planner.plan(images, steps=1)
    position = np.concatenate([np.zeros((1, 3)), plan.position[:, 0]])
    rotation = np.concatenate([np.eye(3)[None], plan.rotation[:, 0]])
    found = label_demonstration(planner, images, (position, rotation), GRASPING, RewardConfig(form="exp"))
    np.testing.assert_allclose(found.reward, GRASPING.astype(float), rtol=0, atol=1e-9)


def test_a_planner_of_positions_needs_no_rotations(tmp_path, images):
    write_random_planner(tmp_path / "p.safetensors", cameras=["agentview"], outputs="position")
    planner = Planner.load(tmp_path / "p.safetensors")
    position, rotation = demonstration()
    bare = label_demonstration(planner, images, (position, None), GRASPING)
    assert bare.rotation is None
    np.testing.assert_array_equal(bare.reward, -0.003 * bare.position)
    full = label_demonstration(planner, images, (position, rotation), GRASPING)
    np.testing.assert_array_equal(full.reward, bare.reward)


@pytest.mark.parametrize("steps", [0, 1])
def test_short_demonstrations(planner, images, steps):
    few = {name: array[:steps] for name, array in images.items()}
    found = label_demonstration(planner, few, demonstration(steps), np.ones(steps, bool))
    assert [array.shape for array in found] == [(steps,)] * 3


def test_nothing_held_is_nothing_planned(planner, images):
    found = label_demonstration(planner, images, demonstration(), np.zeros(STEPS, bool), RewardConfig(form="exp"))
    for array in found:
        assert not np.any(array)


def test_bad_input_is_named(planner, images):
    position, rotation = demonstration()
    with pytest.raises(MismatchError, match="missing: side"):
        label_demonstration(planner, {"agentview": images["agentview"]}, (position, rotation), GRASPING)
    with pytest.raises(ShapeError, match="40 positions for 40 transitions, expected 41"):
        label_demonstration(planner, images, (position[1:], rotation), GRASPING)
    with pytest.raises(ShapeError, match="40 rotations for 40 transitions"):
        label_demonstration(planner, images, (position, rotation[1:]), GRASPING)
    with pytest.raises(ShapeError, match="achieved rotation"):
        label_demonstration(planner, images, (position, None), GRASPING)
    with pytest.raises(ShapeError, match="39 flags, but there are 40 images"):
        label_demonstration(planner, images, (position[1:], rotation[1:]), GRASPING[1:])
    with pytest.raises(ShapeError, match="grasping"):
        label_demonstration(planner, images, (position, rotation), GRASPING.astype(np.float64))
    for step, message in [(-1, "negative"), (6, "6 of 6 steps")]:
        with pytest.raises(InvalidValueError, match=message):
            label_demonstration(planner, images, (position, rotation), GRASPING, step=step)
    with pytest.raises(InvalidValueError, match="potential form"):
        label_demonstration(planner, images, (position, rotation), GRASPING, RewardConfig(form="potential"), step=1)
    for row in (1, 8):  # after a transition without grasp, and with one
        broken = position.copy()
        broken[row, 2] = np.inf
        with pytest.raises(InvalidValueError, match=r"achieved position.*inf"):
            label_demonstration(planner, images, (broken, rotation), GRASPING)
        flipped = rotation.copy()
        flipped[row] = -np.eye(3)
        with pytest.raises(InvalidValueError, match="achieved rotation"):
            label_demonstration(planner, images, (position, flipped), GRASPING)
