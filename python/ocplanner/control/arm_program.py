"""What a program for an arm may sense and do: nothing privileged."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ocplanner import _core
from ocplanner.geometry.pose import Pose

OPEN, STAY, CLOSE = -1.0, 0.0, 1.0


class Arm(Protocol):
    """The part of :class:`ocplanner.envs.ManipulationEnv` that control uses; a test may put something else there."""

    def step(self, action: np.ndarray) -> None: ...  # noqa: D102
    def object_pose(self) -> Pose: ...  # noqa: D102
    def eef_pose(self) -> Pose: ...  # noqa: D102
    @property
    def base_rotation(self) -> np.ndarray: ...  # noqa: D102
    @property
    def gripper_opening(self) -> float: ...  # noqa: D102


class Reachability(Protocol):
    """What an arm knows of its own reach, such as :class:`ocplanner.envs.kinematics.Reach`."""

    def outward(self, position: np.ndarray) -> np.ndarray: ...  # noqa: D102
    def reach_error(self, pose: Pose) -> float: ...  # noqa: D102
    def wrist_room(self, pose: Pose, turn: float) -> float: ...  # noqa: D102


def raised(pose: Pose, height: float) -> Pose:
    """The pose moved up, metres."""
    return Pose(pose.position + np.array([0.0, 0.0, height]), pose.rotation)


class HorizonReached(Exception):  # noqa: N818
    """The episode's steps are used up."""


class Reading(NamedTuple):
    """What is sensed at one control step: poses in the world frame, the finger gap in metres."""

    object: Pose
    eef: Pose
    opening: float

    @property
    def grip_point(self) -> np.ndarray:
        """(3,) where the hand is, in the object's frame: constant while the hold is firm or only turns."""
        return self.object.rotation.T @ (self.eef.position - self.object.position)


class ArmProgram:
    """An arm with a step budget.

    Args:
        arm: the environment; another one may take its place between steps, when another object is in play.
        law: how a pose difference becomes an action.
        horizon: steps until :class:`HorizonReached`.
        on_step: called after every step with the reading.
        holding: the gripper's command while it holds, see :class:`ocplanner.envs.robots.RobotSpec`.
    """

    def __init__(
        self,
        arm: Arm,
        law: _core.DeltaPoseLaw,
        horizon: int,
        on_step: Callable[[Reading], None] | None = None,
        holding: float = CLOSE,
    ) -> None:
        self.arm = arm
        self.law = law
        self.horizon = horizon
        self.steps = 0
        self._on_step = on_step
        self.holding = holding

    def read(self) -> Reading:
        """Sense."""
        return Reading(self.arm.object_pose(), self.arm.eef_pose(), self.arm.gripper_opening)

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step: a normalised end-effector delta (6,) and the gripper's command.

        Raises:
            HorizonReached: no steps are left.
        """
        if self.steps >= self.horizon:
            raise HorizonReached
        self.arm.step(np.append(delta, grip))
        self.steps += 1
        reading = self.read()
        if self._on_step is not None:
            self._on_step(reading)
        return reading

    def wait(self, grip: float) -> Reading:
        """One control step without moving the hand."""
        return self.act(np.zeros(6), grip)

    def move_object(self, target: Pose) -> Reading:
        """One control step of the held object toward a pose."""
        now = self.read()
        delta = _core.delta_pose_action(now.object, target, now.eef, self.arm.base_rotation, self.law)
        return self.act(delta, self.holding)

    def move_hand(self, target: Pose, grip: float) -> Reading:
        """One control step of the hand toward a pose."""
        now = self.read()
        return self.act(_core.delta_pose_action(now.eef, target, now.eef, self.arm.base_rotation, self.law), grip)
