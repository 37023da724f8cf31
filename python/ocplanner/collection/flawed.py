"""Experts with a flaw: episodes that begin well and fail, for telling good behaviour from bad."""

from collections.abc import Callable
from contextlib import suppress
from typing import get_args

import numpy as np

from ocplanner.collection.carrying import DemonstrationVariation, NoisyArmProgram, ObjectLostError
from ocplanner.collection.experts import expert_of
from ocplanner.collection.settings import Flaw
from ocplanner.control.arm import OPEN, Reading
from ocplanner.control.arm_program import HorizonReached
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import UnknownNameError
from ocplanner.geometry.pose import Pose

_AFTERWARDS = 20
"""Steps recorded after a flawed expert has given up."""


class FlawedArmProgram(NoisyArmProgram):
    """A body that, once the object is in hand, may lose it, or sees everything where it is not.

    Args:
        env: the environment.
        manner: decides the tremor.
        rng: source of the tremor.
        on_action: called before each control step with the action (7,).
        lose_after: steps with the object in hand until the hand opens; None: never.
        bias: (3,) how far from where it seems to be everything is while the object is in hand, m.
    """

    def __init__(
        self,
        env: ManipulationEnv,
        manner: DemonstrationVariation,
        rng: np.random.Generator,
        on_action: Callable[[np.ndarray], None],
        lose_after: int | None = None,
        bias: np.ndarray | None = None,
    ) -> None:
        super().__init__(env, env.horizon, manner.noise, rng, on_action)
        self._lose_after, self._bias = lose_after, np.zeros(3) if bias is None else bias
        self._in_hand: int | None = None
        self.steady = True

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step."""
        if not self.steady and self._in_hand is None:
            self._in_hand = 0  # an expert's hand is steady until it has taken hold
        if self._in_hand is not None:
            self._in_hand += 1
            if self._lose_after is not None and self._in_hand > self._lose_after:
                grip = OPEN
        return super().act(delta, grip)

    def read(self) -> Reading:
        """Sense, wrongly where there is a bias."""
        now = super().read()
        if self.steady and self._in_hand is None:
            return now
        seen, hand = (Pose(pose.position - self._bias, pose.rotation) for pose in (now.object, now.eef))
        return Reading(seen, hand, now.opening)


def fail(
    env: ManipulationEnv, seed: int, flaw: Flaw, on_action: Callable[[np.ndarray], None], *, noise: float = 1.0
) -> bool:
    """Reset to a seed and let the expert err in one way; otherwise as :func:`ocplanner.collection.expert.demonstrate`.

    Args:
        env: the robot before its task.
        seed: of the reset, of the manner and of the flaw's size.
        flaw: ``early-release`` opens the hand 10 to 40 steps after the object was taken; ``misjudged-goal`` puts the
            object down 5 to 12 cm short of its goal.
        on_action: called before each control step with the action (7,).
        noise: how far the episodes differ in path and tremor: 1 about as people's, 0 not at all.

    Returns:
        Whether the task is solved nevertheless.

    Raises:
        UnknownNameError: no such flaw, or no expert for the task.
    """
    if flaw not in get_args(Flaw):
        raise UnknownNameError("flaw", flaw, get_args(Flaw))
    expert = expert_of(env.task.name)
    env.reset(seed)
    rng = np.random.default_rng([seed, 1])
    manner = expert.manner(rng).scaled(noise)
    if flaw == "early-release":
        body = FlawedArmProgram(env, manner, rng, on_action, lose_after=int(rng.integers(10, 40)))
    else:
        angle, distance = rng.uniform(0.5 * np.pi, 1.5 * np.pi), rng.uniform(0.05, 0.12)  # toward the robot: in reach
        bias = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        body = FlawedArmProgram(env, manner, rng, on_action, bias=bias)
    try:
        with suppress(ObjectLostError):
            expert.solve(env, body, manner)
        for _ in range(_AFTERWARDS):
            body.wait(OPEN)
    except HorizonReached:
        return False
    return env.success()
