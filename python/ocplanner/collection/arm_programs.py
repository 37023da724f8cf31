"""Arms as a scripted expert moves them: with a tremor, and on purpose with a flaw."""

from collections.abc import Callable

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import OPEN, Reading
from ocplanner.control.arm_multiplexer import ArmMultiplexer
from ocplanner.control.arm_program import ArmProgram
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

_GAIN = 1.5
_NEAR, _NEAR_ROTATION = 0.02, 0.15  # m, rad
_PERSISTENCE, _FRESH = 0.8, 0.6  # of the tremor: 0.8^2 + 0.6^2 = 1 keeps its standard deviation
_SHARES = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])  # of the tremor in position and rotation


class NoisyArmProgram(ArmProgram):
    """All arms of an environment, one active at a time, with a slow tremor (autoregressive noise) on each action.

    Args:
        env: the environment.
        noise: standard deviation of the tremor, in units of the action; a fifth of it on the rotation.
        rng: its source.
        on_action: called before each control step with the action of all arms (7 arms,).

    Attributes:
        arms: chooses the active arm and object, and keeps the other arms in place.
        steady: whether the tremor is switched off.
    """

    def __init__(
        self,
        env: ManipulationEnv,
        noise: float,
        rng: np.random.Generator,
        on_action: Callable[[np.ndarray], None],
    ) -> None:
        law = _core.DeltaPoseLaw(gain_position=_GAIN, gain_rotation=_GAIN)
        self.arms = ArmMultiplexer(env, law, env.task.object().name, on_action)
        super().__init__(self.arms, law, env.horizon)
        self._noise, self._rng = noise, rng
        self._tremor = np.zeros(6)
        self.steady = False

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step, with the tremor unless :attr:`steady`."""
        fresh = _FRESH * self._rng.normal(0.0, self._noise, 6) * _SHARES
        self._tremor = _PERSISTENCE * self._tremor + fresh
        noisy = delta if self.steady else np.clip(delta + self._tremor, -1.0, 1.0)
        return super().act(noisy, grip)

    def return_hand(self, pose: Pose) -> None:
        """Move the open hand near a pose (2 cm, 0.15 rad), world.

        Raises:
            HorizonReached: it took too long.
        """
        now = self.read().eef
        while (
            np.linalg.norm(now.position - pose.position) > _NEAR
            or angle_between(now.rotation, pose.rotation) > _NEAR_ROTATION
        ):
            now = self.move_hand(pose, OPEN).eef


class FlawedArmProgram(NoisyArmProgram):
    """An arm that, once it holds the object, drops it, or senses all poses with a bias.

    Args:
        env: as for :class:`NoisyArmProgram`, as are the next three.
        noise: see there.
        rng: see there.
        on_action: see there.
        lose_after: steps with the object in hand until the hand opens; None: never.
        bias: (3,) subtracted from every position sensed while the object is in hand, world, m.
    """

    def __init__(
        self,
        env: ManipulationEnv,
        noise: float,
        rng: np.random.Generator,
        on_action: Callable[[np.ndarray], None],
        lose_after: int | None = None,
        bias: np.ndarray | None = None,
    ) -> None:
        super().__init__(env, noise, rng, on_action)
        self._lose_after, self._bias = lose_after, np.zeros(3) if bias is None else bias
        self._in_hand: int | None = None
        self.steady = True

    def act(self, delta: np.ndarray, grip: float) -> Reading:
        """One control step."""
        if not self.steady and self._in_hand is None:
            self._in_hand = 0  # an expert's hand is steady until it holds the object
        if self._in_hand is not None:
            self._in_hand += 1
            if self._lose_after is not None and self._in_hand > self._lose_after:
                grip = OPEN
        return super().act(delta, grip)

    def read(self) -> Reading:
        """Sense, with the bias if the object is in hand."""
        now = super().read()
        if self.steady and self._in_hand is None:
            return now
        seen, hand = (Pose(pose.position - self._bias, pose.rotation) for pose in (now.object, now.eef))
        return Reading(seen, hand, now.opening)
