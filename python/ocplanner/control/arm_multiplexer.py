"""The arms of one environment as a program moves them: one at a time, while the others wait."""

from collections.abc import Callable

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import OPEN, WorkCell
from ocplanner.geometry.pose import Pose

_AS_HIGH = 0.03  # m


class ArmMultiplexer:
    """The arm in play and the object in play: an :class:`ocplanner.control.arm.Arm`.

    The other arms hold their hands where they were when they were last in play, or go where they are to wait, and keep
    their grippers as they were.

    Args:
        cell: the arms.
        law: how a waiting hand is kept in its place.
        name: of the object in play at first; the first arm is in play with it.
        on_action: called before each control step with the action of all arms (7 arms,).

    Attributes:
        arm: number of the arm in play.
    """

    def __init__(
        self,
        cell: WorkCell,
        law: _core.DeltaPoseLaw,
        name: str,
        on_action: Callable[[np.ndarray], None] = lambda _: None,
    ) -> None:
        self._cell, self._law, self._on_action = cell, law, on_action
        self.arm, self._object = 0, name
        self._places = [arm.eef_pose() for arm in cell.arms]
        self._grips = [OPEN for _ in cell.arms]
        self._rising = [False for _ in cell.arms]

    def activate(self, name: str, arm: int) -> None:
        """From now on this object is read, and this arm moves.

        Args:
            name: of the object.
            arm: its number.
        """
        self.wait_at(self.eef_pose(), self.arm)
        self.arm, self._object = arm, name

    def wait_at(self, place: Pose, arm: int, *, rising: bool = False) -> None:
        """Where an arm is to wait that is not in play.

        Args:
            place: of its hand, world.
            arm: its number.
            rising: whether the hand goes up first, and aside when it is as high.
        """
        self._places[arm], self._rising[arm] = place, rising

    def open(self, arm: int) -> None:
        """Let an arm that is not in play open its hand."""
        self._grips[arm] = OPEN

    def step(self, action: np.ndarray) -> None:
        """One control step of the arm in play, (7,)."""
        self._grips[self.arm] = float(action[6])
        shares = [action if arm == self.arm else self._keep(arm) for arm in range(len(self._cell.arms))]
        whole = np.concatenate(shares)
        self._on_action(whole)
        self._cell.step(whole)

    def object_pose(self) -> Pose:
        """Of the object in play."""
        return self._cell.object_pose(self._object)

    def eef_pose(self) -> Pose:
        """Of the arm in play."""
        return self._cell.arms[self.arm].eef_pose()

    @property
    def base_rotation(self) -> np.ndarray:
        """Of the arm in play."""
        return self._cell.arms[self.arm].base_rotation

    @property
    def gripper_opening(self) -> float:
        """Of the arm in play."""
        return self._cell.arms[self.arm].gripper_opening

    def _keep(self, number: int) -> np.ndarray:
        """(7,) action of an arm that waits: without it the hand would sink under its load."""
        arm = self._cell.arms[number]
        hand, place = arm.eef_pose(), self._places[number]
        if self._rising[number] and hand.position[2] < place.position[2] - _AS_HIGH:
            place = place._replace(position=np.append(hand.position[:2], place.position[2]))
        delta = _core.delta_pose_action(hand, place, hand, arm.base_rotation, self._law)
        return np.append(delta, self._grips[number])
