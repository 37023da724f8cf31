"""The reward of a demonstration, from its images."""

import numpy as np
from numpy.typing import NDArray

from ocplanner.errors import InvalidValueError, ShapeError
from ocplanner.guidance.rewards import DEFAULT, ObjectPoses, Rewards
from ocplanner.guidance.settings import RewardConfig
from ocplanner.planner.planner import Images, Planner


def label_demonstration(
    planner: Planner,
    images: Images,
    poses: ObjectPoses,
    grasping: NDArray[np.bool_],
    config: RewardConfig = DEFAULT,
    *,
    step: int = 0,
    terminal: bool = True,
    threads: int = 1,
) -> Rewards:
    """Plan along a demonstration and reward its transitions as :func:`ocplanner.guidance.plan_reward` does.

    Plans are made only where the object is held, and no further than the step that is compared.

    Args:
        planner: the planner; one of positions needs no rotations in ``poses``.
        images: camera name -> (T, h, w, 3) uint8 RGB, upright, C-contiguous: what is seen before each transition.
        poses: the object's poses before each transition and after the last: positions (T + 1, 3) float64 in m and
            rotations (T + 1, 3, 3) float64, object -> world, or None.
        grasping: (T,) bool, whether the robot holds the object during the transition.
        config: weights and form.
        step: the planned step that is compared, 0 for the next. A later one is compared with the object that many
            steps later, with its last pose once the demonstration is over, as the planner was trained.
        terminal: the last transition ends the episode for good, not by a time limit; only ``potential`` asks.
        threads: threads to deal the images out to; the rewards depend on it only by rounding.

    Raises:
        InvalidValueError: a number is not finite, grasp or not, a matrix is no rotation, a reward overflows, or
            ``step`` is beyond the plan or, with the form ``potential``, not 0.
        MismatchError: a camera is missing.
        ShapeError: wrong shape, dtype or memory order, or lengths that do not fit.
    """
    transitions = len(grasping)
    if step < 0:
        raise InvalidValueError(f"step: {step} is negative; the next planned step is 0")
    for name, array in zip(("positions", "rotations"), poses):
        if array is not None and len(array) != transitions + 1:
            raise ShapeError(
                f"poses: {len(array)} {name} for {transitions} transitions, expected {transitions + 1}: one before "
                "each transition and one after the last; where the recording ends before that, repeat its last pose"
            )
    due = np.minimum(np.arange(transitions) + 1 + step, transitions)
    position, rotation = poses
    achieved = (position[due], None if rotation is None else rotation[due])
    return Rewards(
        *config.law.label(
            planner.engine, planner.arrays(images), achieved, grasping, step=step, terminal=terminal, threads=threads
        )
    )
