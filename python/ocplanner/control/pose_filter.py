"""Steadies an estimated object pose by what is known exactly: where the hand is."""

from collections import deque

import numpy as np

from ocplanner.control.arm import Arm
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import rotation_exp, rotation_log

_WORLD = Pose(np.zeros(3), np.eye(3))


class FilteredArm:
    """An arm whose object pose is a running mean of the estimates; all else is the arm's own.

    From the command to close until the command to open, the object is assumed to move with the hand, and its pose in
    the hand's frame is averaged; otherwise it is assumed to lie still in the world. A late estimate is combined with
    where the hand was then, which makes up for the object's motion with the hand since.

    Args:
        arm: the arm, with the object that it works on.
        steps: time constant of the mean, control steps; 1 takes every estimate as it is.
        latency_steps: age of the estimates, known from their time stamps.
    """

    def __init__(self, arm: Arm, steps: int, latency_steps: int) -> None:
        self._arm, self._weight = arm, 1.0 / steps
        self._hands: deque[Pose] = deque([arm.eef_pose()], maxlen=latency_steps + 1)
        self._closing = False
        self._mean = arm.object_pose()

    def step(self, action: np.ndarray) -> None:
        """One control step of the arm, and the mean with the estimate after it."""
        before = self.object_pose()
        hand = self._arm.eef_pose()
        self._arm.step(action)
        if action[-1] != 0 and (action[-1] > 0) != self._closing:
            self._closing = not self._closing
            self._mean = (hand if self._closing else _WORLD).inverse() @ before
        self._hands.append(self._arm.eef_pose())
        then = self._hands[0] if self._closing else _WORLD
        self._mean = _between(self._mean, then.inverse() @ self._arm.object_pose(), self._weight)

    def object_pose(self) -> Pose:
        """The mean, carried to where the hand is now."""
        return (self._hands[-1] if self._closing else _WORLD) @ self._mean

    def eef_pose(self) -> Pose:
        """The arm's own."""
        return self._arm.eef_pose()

    @property
    def base_rotation(self) -> np.ndarray:
        """The arm's own."""
        return self._arm.base_rotation

    @property
    def gripper_opening(self) -> float:
        """The arm's own."""
        return self._arm.gripper_opening


def _between(a: Pose, b: Pose, weight: float) -> Pose:
    """The pose that lies ``weight`` in [0, 1] of the way from ``a`` to ``b``."""
    turn = weight * rotation_log(a.rotation.T @ b.rotation)
    return Pose(a.position + weight * (b.position - a.position), a.rotation @ rotation_exp(turn))
