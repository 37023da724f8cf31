"""The plan's reward in plain NumPy, as it would be written without the native module."""

from typing import NamedTuple

import numpy as np

_A = _B = 0.003


class Rewards(NamedTuple):
    """Position and rotation terms (T,), unweighted, and rewards (T,), in the default form."""

    position: np.ndarray
    rotation: np.ndarray
    reward: np.ndarray


def plan_reward(
    planned: tuple[np.ndarray, np.ndarray], achieved: tuple[np.ndarray, np.ndarray], grasping: np.ndarray
) -> Rewards:
    """What ``ocplanner.guidance.plan_reward`` computes by default.

    A pair is (T, 3) positions in m and (T, 3, 3) rotations: where the plan made at t puts the object next, and where it
    is next. ``grasping`` is (T,) bool.
    """
    position = np.where(grasping, np.square(planned[0] - achieved[0]).sum(-1), 0.0)
    columns = planned[1][..., :2] - achieved[1][..., :2]
    rotation = np.where(grasping, np.square(columns).sum((-2, -1)), 0.0)
    return Rewards(position, rotation, -(_A * position + _B * rotation))
