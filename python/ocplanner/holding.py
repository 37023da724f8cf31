"""When the robot holds the object: where a plan may hint and reward. The same rule for recordings and live."""

from dataclasses import dataclass

import numpy as np

from ocplanner.errors import ShapeError
from ocplanner.pose import Pose


@dataclass(frozen=True)
class HoldRule:
    """When a closed gripper holds the object.

    Attributes:
        moved: the object has moved this far (m) since the gripper began to close.
        slipped: the hand is no farther (m) from where it then was in the object's frame.
    """

    moved: float = 0.004
    slipped: float = 0.04


DEFAULT_RULE = HoldRule()


class Hold:
    """Follows an episode step by step and says whether the object is held; looks at nothing that is yet to come."""

    def __init__(self, rule: HoldRule = DEFAULT_RULE) -> None:
        self._rule = rule
        self._closed_at: tuple[np.ndarray, np.ndarray] | None = None

    def update(self, object_pose: Pose, eef_position: np.ndarray, last_gripper: float) -> bool:
        """Whether the object is held before the next action.

        Args:
            object_pose: present pose, world.
            eef_position: (3,) present position of the end-effector site, world, metres.
            last_gripper: the gripper's part of the last action: above 0 closes, below 0 opens, 0 keeps. Before the
                first action, any number below 0.
        """
        if last_gripper < 0:
            self._closed_at = None
        grip = object_pose.rotation.T @ (eef_position - object_pose.position)
        if self._closed_at is None:
            if last_gripper > 0:
                self._closed_at = (object_pose.position.copy(), grip)
            return False
        start, start_grip = self._closed_at
        moved = float(np.linalg.norm(object_pose.position - start))
        slipped = float(np.linalg.norm(grip - start_grip))
        return moved > self._rule.moved and slipped < self._rule.slipped


def held_steps(
    object_positions: np.ndarray,
    object_rotations: np.ndarray,
    eef_positions: np.ndarray,
    gripper_actions: np.ndarray,
    rule: HoldRule = DEFAULT_RULE,
) -> np.ndarray:
    """(T,) bool: the object is held before the action of that step, as :class:`Hold` tells it live.

    Args:
        object_positions: (T, 3) world, metres.
        object_rotations: (T, 3, 3), object -> world.
        eef_positions: (T, 3) of the end-effector site, world, metres.
        gripper_actions: (T,), above 0 closes and below 0 opens, 0 keeps.
        rule: thresholds.

    Raises:
        ShapeError: the arrays do not fit together.
    """
    steps = len(gripper_actions)
    shapes = (object_positions.shape, object_rotations.shape, eef_positions.shape)
    if shapes != ((steps, 3), (steps, 3, 3), (steps, 3)):
        raise ShapeError(f"positions, rotations and hands of shapes {shapes} for {steps} actions; expected one a step")
    hold = Hold(rule)
    last = np.concatenate([[-1.0], gripper_actions[:-1]])
    poses = zip(object_positions, object_rotations, eef_positions, last)
    held = [hold.update(Pose(position, rotation), eef, float(given)) for position, rotation, eef, given in poses]
    return np.array(held, dtype=bool)
