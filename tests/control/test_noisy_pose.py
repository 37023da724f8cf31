"""An imperfect estimator of object poses, before a work cell that only counts its steps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from floating_cell import FloatingArm
from ocplanner.control.noisy_pose import NoisyPoseCell, PoseError
from ocplanner.envs.robots import RobotSpec
from ocplanner.errors import InvalidValueError
from ocplanner.geometry.pose import Pose


class Counting:
    """A work cell whose objects move 1 m along x in each step."""

    robot = RobotSpec("Panda")

    def __init__(self) -> None:
        self.steps = 0
        self.arms = [FloatingArm(Pose(np.array([0.0, 0.0, 1.0]), np.eye(3)))]

    def step(self, action) -> None:
        self.steps += 1

    def object_pose(self, name: str) -> Pose:
        return Pose(np.array([float(self.steps), 0.0, 0.0]), Rotation.from_euler("z", 0.3).as_matrix())


def noisy(error: PoseError, seed: int) -> NoisyPoseCell:
    return NoisyPoseCell(Counting(), ["nut", "peg"], error, seed)


def readings(error: PoseError, seed: int, steps: int, name: str = "nut") -> list[Pose]:
    cell = noisy(error, seed)
    poses = [cell.object_pose(name)]
    for _ in range(steps):
        cell.step(np.zeros(7))
        poses.append(cell.object_pose(name))
    return poses


def errors(error: PoseError, steps: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Of position (N, 3), metres, and of rotation (N, 3), rotation vectors in radians."""
    poses = readings(error, 0, steps)
    turns = np.array([pose.rotation for pose in poses]) @ Counting().object_pose("nut").rotation.T
    positions = np.array([pose.position for pose in poses])
    positions[:, 0] -= np.arange(len(poses))
    return positions, Rotation.from_matrix(turns).as_rotvec()


def test_the_noise_has_the_size_asked_for_in_every_direction_and_no_bias():
    positions, turns = errors(PoseError(5.0, 2.0))
    assert positions.std(axis=0) == pytest.approx([0.005] * 3, rel=0.06)
    assert np.sqrt((turns**2).sum(axis=1).mean()) == pytest.approx(np.radians(2.0), rel=0.06)
    assert turns.std(axis=0) == pytest.approx([np.radians(2.0) / np.sqrt(3)] * 3, rel=0.1)
    assert np.abs(positions.mean(axis=0)).max() < 0.0003
    assert abs(np.corrcoef(positions[:-1, 0], positions[1:, 0])[0, 1]) < 0.06  # each step has its own


def test_one_estimate_a_step_and_the_seed_decides():
    cell = noisy(PoseError(5.0, 2.0), 3)
    assert np.array_equal(cell.object_pose("nut").position, cell.object_pose("nut").position)
    first, again, other = (readings(PoseError(5.0, 2.0), seed, 3)[-1] for seed in (3, 3, 4))
    assert np.array_equal(first.position, again.position)
    assert not np.array_equal(first.position, other.position)
    small, large = (errors(PoseError(size, 0.0), 5)[0] for size in (1.0, 10.0))
    assert large == pytest.approx(10 * small)


def test_each_object_has_noise_of_its_own():
    nut, peg = (readings(PoseError(5.0, 2.0), 3, 3, name) for name in ("nut", "peg"))
    assert not any(np.allclose(a.position, b.position) for a, b in zip(nut, peg, strict=True))


def test_the_first_objects_draws_are_those_of_an_episode_with_one_object():
    """The results under noise were made with these draws."""
    rng = np.random.default_rng([0x705E, 3])
    error = PoseError(5.0, 2.0)
    expected = [error.disturb(Pose(np.array([step, 0.0, 0.0]), np.eye(3)), rng).position for step in range(4)]
    assert np.array_equal([pose.position for pose in readings(error, 3, 3)], expected)


def test_estimates_come_late():
    poses = readings(PoseError(latency_steps=2), 0, 5)
    assert [pose.position[0] for pose in poses] == [0, 0, 0, 1, 2, 3]


def test_without_an_error_the_pose_is_exact_and_all_else_always_is():
    cell, exact = noisy(PoseError(), 0), Counting()
    assert np.array_equal(cell.object_pose("nut").position, exact.object_pose("nut").position)
    assert np.array_equal(cell.object_pose("nut").rotation, exact.object_pose("nut").rotation)
    wrong = noisy(PoseError(50.0, 50.0, 5), 0)
    assert np.array_equal(wrong.arms[0].eef_pose().position, exact.arms[0].eef_pose().position)
    assert wrong.arms[0].gripper_opening == exact.arms[0].gripper_opening
    assert wrong.robot is exact.robot


@pytest.mark.parametrize("values", [(-1.0,), (0.0, -1.0), (float("nan"),), (0.0, float("inf")), (0.0, 0.0, -1)])
def test_impossible_errors_are_refused(values):
    with pytest.raises(InvalidValueError, match="pose"):
        PoseError(*values)
