"""The filter before an arm whose hand carries its object, or not."""

from collections import deque

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ocplanner.control.noisy_pose import PoseError
from ocplanner.control.pose_filter import FilteredArm
from ocplanner.geometry.pose import Pose

OPEN, STAY, CLOSE = (np.append(np.zeros(6), grip) for grip in (-1.0, 0.0, 1.0))


class Carrying:
    """A hand that rises 1 cm and turns 0.02 rad in each step; closed, it takes the object along."""

    base_rotation = np.eye(3)
    gripper_opening = 0.04

    def __init__(self) -> None:
        self.hand = Pose(np.array([0.0, 0.1, 0.9]), np.eye(3))
        self.closed = False
        self.object = Pose(np.array([0.02, 0.1, 0.8]), Rotation.from_euler("z", 0.4).as_matrix())

    def step(self, action) -> None:
        held = self.hand.inverse() @ self.object
        turn = Rotation.from_euler("x", 0.02).as_matrix()
        self.hand = Pose(self.hand.position + np.array([0.0, 0.0, 0.01]), turn @ self.hand.rotation)
        if action[-1] != 0:
            self.closed = action[-1] > 0
        if self.closed:
            self.object = self.hand @ held

    def object_pose(self) -> Pose:
        return self.object

    def eef_pose(self) -> Pose:
        return self.hand


class Estimated:
    """The same arm, its object's pose noisy and late."""

    base_rotation, gripper_opening = Carrying.base_rotation, Carrying.gripper_opening

    def __init__(self, truth: Carrying, error: PoseError) -> None:
        self.truth, self.error, self.rng = truth, error, np.random.default_rng(0)
        self.seen = deque([self.estimate()], maxlen=error.latency_steps + 1)

    def estimate(self) -> Pose:
        return self.error.disturb(self.truth.object, self.rng)

    def step(self, action) -> None:
        self.truth.step(action)
        self.seen.append(self.estimate())

    def object_pose(self) -> Pose:
        return self.seen[0]

    def eef_pose(self) -> Pose:
        return self.truth.hand


def off(arm: FilteredArm, truth: Carrying) -> float:
    """Distance of what is read from the truth, metres, a radian counted as 1 m."""
    read = arm.object_pose()
    turn = Rotation.from_matrix(read.rotation.T @ truth.object.rotation).magnitude()
    return float(np.linalg.norm(read.position - truth.object.position)) + float(turn)


@pytest.mark.parametrize("latency", [0, 3])
@pytest.mark.parametrize("action", [OPEN, CLOSE])
def test_without_noise_nothing_lags_behind(action, latency):
    truth = Carrying()
    arm = FilteredArm(Estimated(truth, PoseError(latency_steps=latency)), 8, latency)
    for _ in range(20):
        arm.step(action)
        assert off(arm, truth) < 1e-9
    assert np.array_equal(arm.eef_pose().position, truth.hand.position)


def test_grasping_and_letting_go_leave_no_jump():
    truth = Carrying()
    arm = FilteredArm(Estimated(truth, PoseError()), 8, 0)
    for action in (OPEN, CLOSE, STAY, STAY, CLOSE, OPEN, STAY, OPEN, CLOSE):
        arm.step(action)
        assert off(arm, truth) < 1e-9


@pytest.mark.parametrize("action", [OPEN, CLOSE])
def test_noise_is_averaged_out(action):
    def error(steps: int) -> float:
        truth = Carrying()
        arm = FilteredArm(Estimated(truth, PoseError(5.0, 2.0)), steps, 0)
        found = []
        for _ in range(400):
            arm.step(action)
            found.append(off(arm, truth))
        return float(np.sqrt(np.mean(np.square(found[50:]))))

    assert error(8) < 0.4 * error(1)
