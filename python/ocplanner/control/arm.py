"""What control needs of an arm and of the place where it works: protocols that a simulator or a real robot fulfils."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ocplanner.envs.robots import RobotSpec
from ocplanner.geometry.pose import Pose

OPEN, STAY, CLOSE = -1.0, 0.0, 1.0
"""The gripper's part of an action."""


class Reading(NamedTuple):
    """What is sensed at one control step: poses in the world frame, the finger gap in metres."""

    object: Pose
    eef: Pose
    opening: float

    @property
    def grip_point(self) -> np.ndarray:
        """(3,) the hand's position in the object's frame, metres: constant while the hold is firm or only turns."""
        return self.object.rotation.T @ (self.eef.position - self.object.position)


class ArmSensors(Protocol):
    """What an arm knows of itself: its joints and its fingers."""

    def eef_pose(self) -> Pose:
        """Pose of the end-effector site, midway between the finger tips, world frame."""
        ...

    @property
    def base_rotation(self) -> np.ndarray:
        """(3, 3) rotation, frame of the action's deltas -> world; on some arms it turns with the arm."""
        ...

    @property
    def gripper_opening(self) -> float:
        """Gap between the finger pads, metres."""
        ...


class Arm(ArmSensors, Protocol):
    """One arm with one object: what a program senses and acts through. Nothing here is privileged.

    :class:`ocplanner.envs.ManipulationEnv` is one, and so is
    :class:`ocplanner.control.arm_multiplexer.ArmMultiplexer`.
    """

    def step(self, action: np.ndarray) -> None:
        """One control step (0.05 s) of (7,) in [-1, 1]: see :meth:`ocplanner.envs.ManipulationEnv.step`."""

    def object_pose(self) -> Pose:
        """Pose of the object, world frame, metres."""
        ...


class Reachability(Protocol):
    """What an arm knows of its own reach, from its kinematics: :class:`ocplanner.envs.kinematics.Reach` is one."""

    @property
    def base(self) -> np.ndarray:
        """(3,) place of the arm's first joint, world, metres."""
        ...

    def outward(self, position: np.ndarray) -> np.ndarray:
        """(3,) horizontal unit vector from the arm's first joint to a position (3,) in the world."""
        ...

    def reach_error(self, pose: Pose) -> float:
        """The error that is left when the hand is led to a pose, world frame: metres, a radian counted as 0.1 m."""
        ...

    def wrist_room(self, pose: Pose, turn: float) -> float:
        """How far the last joint is within its limits, radians, after turning the hand about the world's z."""
        ...


class CellArm(ArmSensors, Protocol):
    """One arm of a work cell."""

    @property
    def reach(self) -> Reachability:
        """Where it gets to."""
        ...


class WorkCell(Protocol):
    """The arms before a task, all of one kind, and the objects: :class:`ocplanner.envs.ManipulationEnv` is one."""

    @property
    def robot(self) -> RobotSpec:
        """What is particular about the arms."""
        ...

    @property
    def arms(self) -> Sequence[CellArm]:
        """The arms, in the order of their parts of an action."""
        ...

    def object_pose(self, name: str) -> Pose:
        """Pose of an object, world frame, metres."""
        ...

    def step(self, action: np.ndarray) -> None:
        """One control step (0.05 s) of all arms: (7 arms,) in [-1, 1], one after the other."""
