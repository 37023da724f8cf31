"""One attempt of a scripted expert: to solve its task, or to fail at it in a given way."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from ocplanner.collection.arm_programs import FlawedArmProgram, NoisyArmProgram
from ocplanner.collection.carrying import ObjectLostError
from ocplanner.collection.experts import expert_of
from ocplanner.collection.settings import Flaw
from ocplanner.control.arm import OPEN
from ocplanner.control.arm_program import HorizonReached
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.settings import require_choice

_AFTERWARDS = 20  # control steps recorded after a flawed expert has finished or given up


def attempt(
    env: ManipulationEnv,
    seed: int,
    on_action: Callable[[np.ndarray], None],
    *,
    flaw: Flaw | None = None,
    noise: float = 1.0,
) -> bool:
    """Reset to a seed and let the expert try its task.

    Args:
        env: the robot and its task.
        seed: of the reset, of the demonstration's variation and of the flaw's size.
        on_action: called before each control step with the action of all arms (7 arms,).
        flaw: ``early-release`` opens the hand 10 to 40 steps after the object was taken; ``misjudged-goal`` puts the
            object down 5 to 12 cm short of its goal; None: the expert does what it can.
        noise: how much demonstrations differ in path and tremor: 1 about as much as people's, 0 not at all.

    Returns:
        Whether the task is solved.

    Raises:
        UnknownNameError: no such flaw, or no expert for the task.
    """
    expert = expert_of(env.task.name)
    env.reset(seed)
    rng = np.random.default_rng([seed, 1])
    variation = expert.draw_variation(rng).scaled(noise)
    if flaw is None:
        program = NoisyArmProgram(env, variation.noise, rng, on_action)
    else:
        program = _flawed(env, variation.noise, rng, on_action, flaw)
    try:
        with suppress(*([] if flaw is None else [ObjectLostError])):
            expert.solve(env, program, variation)
        for _ in range(0 if flaw is None else _AFTERWARDS):
            program.wait(OPEN)
    except (HorizonReached, ObjectLostError):
        return False
    return env.success()


def _flawed(
    env: ManipulationEnv, noise: float, rng: np.random.Generator, on_action: Callable[[np.ndarray], None], flaw: Flaw
) -> FlawedArmProgram:
    require_choice("flaw", flaw, Flaw)
    if flaw == "early-release":
        return FlawedArmProgram(env, noise, rng, on_action, lose_after=int(rng.integers(10, 40)))
    angle, distance = rng.uniform(0.5 * np.pi, 1.5 * np.pi), rng.uniform(0.05, 0.12)  # toward the robot: in reach
    bias = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
    return FlawedArmProgram(env, noise, rng, on_action, bias=bias)
