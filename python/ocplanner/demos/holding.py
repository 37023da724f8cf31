"""When the robot holds the object: where a plan may hint and reward."""

import numpy as np

from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule, manipulation_segment
from ocplanner.errors import DatasetError


def held_steps(
    object_positions: np.ndarray,
    object_rotations: np.ndarray,
    gripper_actions: np.ndarray,
    rule: SegmentRule = DEFAULT_RULE,
) -> np.ndarray:
    """(T,) bool: the object is held while the action of that step is carried out.

    That is from the step in which the grasped object starts to move to the last before the release, except where the
    gripper opens in between (see :func:`ocplanner.demos.segments.manipulation_segment`, which looks at the whole
    demonstration). Nowhere, if the object is never carried.

    Args:
        object_positions: (T, 3) world, metres.
        object_rotations: (T, 3, 3), object -> world.
        gripper_actions: (T,), above 0 closes and below 0 opens, 0 keeps.
        rule: thresholds.

    Raises:
        ShapeError: the arrays do not fit together.
        InvalidValueError: a number is not finite.
    """
    held = np.zeros(len(gripper_actions), bool)
    try:
        segment = manipulation_segment(object_positions, object_rotations, gripper_actions, rule)
    except DatasetError:
        return held
    closed = _kept(gripper_actions) > 0
    held[segment.onset : segment.release] = closed[segment.onset : segment.release]
    return held


def _kept(gripper_actions: np.ndarray) -> np.ndarray:
    """The commands with every 0 replaced by the last command before it."""
    given = np.where(gripper_actions != 0, np.arange(len(gripper_actions)), 0)
    return gripper_actions[np.maximum.accumulate(given)]
