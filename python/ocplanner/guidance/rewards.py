"""From plans to rewards: how far the object went from where it was planned (the paper's section 5)."""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ocplanner.guidance.settings import RewardConfig

ObjectPoses: TypeAlias = tuple[np.ndarray, np.ndarray | None]
"""Positions (T, 3) float64 in m and rotations (T, 3, 3) float64, object -> world, or None."""

DEFAULT_REWARD = RewardConfig()


class Rewards(NamedTuple):
    """Terms and rewards of an episode's T transitions.

    Attributes:
        position: (T,) float64, |p' - p|^2 in m^2, unweighted; 0 without a grasp.
        rotation: (T,) float64, |r' - r|^2, unweighted; 0 without a grasp. None if the plan has no rotations.
        reward: (T,) float64.
    """

    position: np.ndarray
    rotation: np.ndarray | None
    reward: np.ndarray


def plan_reward(
    planned: ObjectPoses,
    achieved: ObjectPoses,
    grasping: NDArray[np.bool_],
    config: RewardConfig = DEFAULT_REWARD,
    *,
    terminal: bool = True,
) -> Rewards:
    """Reward every transition by the distance between the planned and the achieved pose of the object.

    The rotation term compares rotations as the paper writes them: the six numbers of the first two columns of the
    matrix. For rotations an angle theta apart about the axis n, in the object's frame, it is
    2 (1 - cos theta)(1 + n_z^2). Without a grasp, terms and rewards are 0, since the plan then says nothing about what
    the robot does.

    With ``form="potential"`` the potential of a state is -E of the transition that led to it; it is 0 in the first
    state, after a transition without a grasp, and in a terminal state. So a grasp begins with -gamma E, and the first
    transition after it pays the last E back. Over an episode that ends in a terminal state the discounted rewards sum
    to 0, otherwise to gamma^T Phi(s_T).

    Args:
        planned: for each transition from t to t + 1 the plan made at t, m'_{t+1}: positions (T, 3) float64 in m and
            rotations (T, 3, 3) float64, object -> world, or None from a planner of positions.
        achieved: where the object is afterwards, m_{t+1}, likewise; its rotations are ignored where none are planned.
        grasping: (T,) bool, whether the robot holds the object during the transition.
        config: weights and form.
        terminal: the last transition ends the episode for good, not by a time limit; only ``potential`` asks.

    Raises:
        InvalidValueError: a number is not finite, grasp or not, a matrix is no rotation, or a reward overflows.
        ShapeError: wrong shape or dtype, or lengths that differ.
    """
    return Rewards(*config.law.rewards(_rows(planned), _rows(achieved), grasping, terminal=terminal))


def _rows(poses: ObjectPoses) -> ObjectPoses:
    """C-contiguous arrays: the first step of a batch of plans, ``plan.position[:, 0]``, is not."""
    position, rotation = poses
    return np.ascontiguousarray(position), None if rotation is None else np.ascontiguousarray(rotation)
