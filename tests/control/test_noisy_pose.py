"""An imperfect estimator of the object's pose, before an arm that only counts its steps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocplanner.control.noisy_pose import NoisyPoseArm, PoseError, parse_noise
from ocplanner.errors import InvalidValueError
from ocplanner.geometry.pose import Pose


class Counting:
    """An arm whose object moves 1 m along x in each step."""

    base_rotation = np.eye(3)
    gripper_opening = 0.04

    def __init__(self) -> None:
        self.steps = 0

    def step(self, action) -> None:
        self.steps += 1

    def object_pose(self) -> Pose:
        return Pose(np.array([float(self.steps), 0.0, 0.0]), Rotation.from_euler("z", 0.3).as_matrix())

    def eef_pose(self) -> Pose:
        return Pose(np.array([0.0, 0.0, 1.0]), np.eye(3))


def readings(error: PoseError, seed: int, steps: int) -> list[Pose]:
    arm = NoisyPoseArm(Counting(), error, seed)
    poses = [arm.object_pose()]
    for _ in range(steps):
        arm.step(np.zeros(7))
        poses.append(arm.object_pose())
    return poses


def errors(error: PoseError, steps: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Of position (N, 3), metres, and of rotation (N, 3), rotation vectors in radians."""
    poses = readings(error, 0, steps)
    turns = np.array([pose.rotation for pose in poses]) @ Counting().object_pose().rotation.T
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
    arm = NoisyPoseArm(Counting(), PoseError(5.0, 2.0), 3)
    assert np.array_equal(arm.object_pose().position, arm.object_pose().position)
    first, again, other = (readings(PoseError(5.0, 2.0), seed, 3)[-1] for seed in (3, 3, 4))
    assert np.array_equal(first.position, again.position)
    assert not np.array_equal(first.position, other.position)
    small, large = (errors(PoseError(size, 0.0), 5)[0] for size in (1.0, 10.0))
    assert large == pytest.approx(10 * small)


def test_estimates_come_late():
    poses = readings(PoseError(latency_steps=2), 0, 5)
    assert [pose.position[0] for pose in poses] == [0, 0, 0, 1, 2, 3]


def test_without_an_error_the_pose_is_exact_and_all_else_always_is():
    arm, exact = NoisyPoseArm(Counting(), PoseError(), 0), Counting()
    assert np.array_equal(arm.object_pose().position, exact.object_pose().position)
    assert np.array_equal(arm.object_pose().rotation, exact.object_pose().rotation)
    wrong = NoisyPoseArm(Counting(), PoseError(50.0, 50.0, 5), 0)
    assert np.array_equal(wrong.eef_pose().position, exact.eef_pose().position)
    assert wrong.gripper_opening == exact.gripper_opening


def test_labels_name_what_is_wrong():
    assert PoseError().labels == ()
    assert PoseError(5.0, 2.0).labels == ("noise5mm2deg",)
    assert PoseError(0.5, latency_steps=3).labels == ("noise0.5mm0deg", "latency3")
    assert PoseError(latency_steps=3).labels == ("latency3",)


@pytest.mark.parametrize("values", [(-1.0,), (0.0, -1.0), (float("nan"),), (0.0, float("inf")), (0.0, 0.0, -1)])
def test_impossible_errors_are_refused(values):
    with pytest.raises(InvalidValueError, match="pose"):
        PoseError(*values)


def test_noise_is_two_numbers():
    assert parse_noise("5,2.5") == (5.0, 2.5)
    for text in ("5", "5,2,1", "5 2", "", "a,b"):
        with pytest.raises(InvalidValueError, match="MM,DEG"):
            parse_noise(text)
