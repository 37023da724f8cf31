"""The arms of one work cell as a program moves them: one at a time, while the others wait."""

from collections.abc import Callable

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import OPEN, WorkCell
from ocplanner.control.settings import SeveralArmsSettings
from ocplanner.geometry.pose import Pose


class ArmMultiplexer:
    """The active arm with the active object: an :class:`ocplanner.control.arm.Arm`.

    The other arms hold their hands where they were when they were last active, or go where they are to wait, and keep
    their grippers as they were.

    Args:
        cell: the arms.
        law: how a waiting hand is kept in its place.
        name: of the object that is active at first, together with the first arm.
        on_action: called before each control step with the action of all arms (7 arms,).
        level: see :class:`ocplanner.control.settings.SeveralArmsSettings`.

    Attributes:
        arm: number of the active arm.
    """

    def __init__(
        self,
        cell: WorkCell,
        law: _core.DeltaPoseLaw,
        name: str,
        on_action: Callable[[np.ndarray], None] = lambda _: None,
        level: float = SeveralArmsSettings.level,
    ) -> None:
        self._cell, self._law, self._on_action, self._level = cell, law, on_action, level
        self.arm, self._object = 0, name
        self._places = [arm.eef_pose() for arm in cell.arms]
        self._grips = [OPEN for _ in cell.arms]
        self._rising = [False for _ in cell.arms]

    def activate(self, name: str, arm: int) -> None:
        """From now on this object is sensed, and this arm moves.

        Args:
            name: of the object.
            arm: its number.
        """
        self.wait_at(self.eef_pose(), self.arm)
        self.arm, self._object = arm, name

    def wait_at(self, place: Pose, arm: int, *, rising: bool = False) -> None:
        """Where an arm is to wait while it is not active.

        Args:
            place: of its hand, world.
            arm: its number.
            rising: whether the hand goes up first, and aside when it is as high.
        """
        self._places[arm], self._rising[arm] = place, rising

    def open(self, arm: int) -> None:
        """Let an arm that is not active open its hand."""
        self._grips[arm] = OPEN

    def step(self, action: np.ndarray) -> None:
        """One control step of the active arm, (7,)."""
        self._grips[self.arm] = float(action[6])
        parts = [action if arm == self.arm else self._keep(arm) for arm in range(len(self._cell.arms))]
        whole = np.concatenate(parts)
        self._on_action(whole)
        self._cell.step(whole)

    def object_pose(self) -> Pose:
        """Of the active object."""
        return self._cell.object_pose(self._object)

    def eef_pose(self) -> Pose:
        """Of the active arm."""
        return self._cell.arms[self.arm].eef_pose()

    @property
    def base_rotation(self) -> np.ndarray:
        """Of the active arm."""
        return self._cell.arms[self.arm].base_rotation

    @property
    def gripper_opening(self) -> float:
        """Of the active arm."""
        return self._cell.arms[self.arm].gripper_opening

    def _keep(self, number: int) -> np.ndarray:
        """(7,) action of an arm that waits: without it the hand would sink under its load."""
        arm = self._cell.arms[number]
        hand, place = arm.eef_pose(), self._places[number]
        if self._rising[number] and hand.position[2] < place.position[2] - self._level:
            place = place._replace(position=np.append(hand.position[:2], place.position[2]))
        delta = _core.delta_pose_action(hand, place, hand, arm.base_rotation, self._law)
        return np.append(delta, self._grips[number])
