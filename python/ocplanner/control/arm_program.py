"""One control step after another: an arm with a budget of steps."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import CLOSE, Arm, Reading
from ocplanner.geometry.pose import Pose


class HorizonReached(Exception):  # noqa: N818
    """The episode's steps are used up."""


class Patience(NamedTuple):
    """When a motion of the hand is given up.

    Attributes:
        steps: control steps that it may take.
        still: motion in a step below which the hand does not get on, metres.
        still_steps: steps in a row without motion after which it is as near as the arm gets.
    """

    steps: int
    still: float
    still_steps: int


def distance_moved(before: Pose, after: Pose) -> float:
    """How far a hand has moved, metres."""
    return float(np.linalg.norm(after.position - before.position))


class ArmProgram:
    """An arm with a step budget.

    Args:
        arm: what is sensed and acts; another one may take its place between steps, when another object or arm becomes
            active.
        law: how a pose difference becomes an action.
        horizon: steps until :class:`HorizonReached`.
        on_step: called after every step with the reading.
        holding: the gripper's command while it holds, see :class:`ocplanner.envs.robots.RobotSpec`.

    Attributes:
        steps: control steps so far.
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
        self.holding = holding
        self.steps = 0
        self._on_step = on_step

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

    def travel(
        self,
        aim: Callable[[Reading], tuple[Pose, float]],
        has_arrived: Callable[[Reading, Pose, float], bool],
        patience: Patience,
        moved: Callable[[Pose, Pose], float] = distance_moved,
    ) -> None:
        """Move the hand until it has arrived, or as near as the arm gets.

        Args:
            aim: the hand's next target, world, and the gripper's command, from what is sensed.
            has_arrived: whether that is so, from what is sensed, the last target and the motion in the last step.
            patience: when the motion is given up.
            moved: how the hand's motion from one pose to the next is measured.

        Raises:
            HorizonReached: no steps are left.
        """
        before, still = self.read(), 0
        for _ in range(patience.steps):
            target, grip = aim(before)
            now = self.move_hand(target, grip)
            motion = moved(before.eef, now.eef)
            if has_arrived(now, target, motion):
                return
            still = still + 1 if motion < patience.still else 0
            if still >= patience.still_steps:
                return
            before = now
