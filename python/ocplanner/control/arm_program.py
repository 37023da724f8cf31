"""One control step after another: an arm with a budget of steps."""

from collections.abc import Callable

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import CLOSE, Arm, Reading
from ocplanner.geometry.pose import Pose


class HorizonReached(Exception):  # noqa: N818
    """The episode's steps are used up."""


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
