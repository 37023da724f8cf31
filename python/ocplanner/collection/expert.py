"""One demonstration of a scripted expert."""

from collections.abc import Callable

import numpy as np

from ocplanner.collection.carrying import NoisyArmProgram, ObjectLostError
from ocplanner.collection.experts import expert_of
from ocplanner.control.arm_program import HorizonReached
from ocplanner.envs.environment import ManipulationEnv


def demonstrate(
    env: ManipulationEnv, seed: int, on_action: Callable[[np.ndarray], None], *, noise: float = 1.0
) -> bool:
    """Reset to a seed and let the expert work in a manner that the seed decides.

    Args:
        env: the robot before its task.
        seed: of the reset and of the manner.
        on_action: called before each control step with the action (7 arms,).
        noise: how far demonstrations differ in path and tremor: 1 about as people's, 0 not at all.

    Returns:
        Whether the task is solved.

    Raises:
        UnknownNameError: the task has no expert.
    """
    expert = expert_of(env.task.name)
    env.reset(seed)
    rng = np.random.default_rng([seed, 1])
    manner = expert.manner(rng).scaled(noise)
    body = NoisyArmProgram(env, env.horizon, manner.noise, rng, on_action)
    try:
        expert.solve(env, body, manner)
    except (HorizonReached, ObjectLostError):
        return False
    return env.success()
