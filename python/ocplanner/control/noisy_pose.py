"""Object poses as an imperfect estimator gives them: noisy, and late."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from ocplanner.control.arm import CellArm, WorkCell
from ocplanner.envs.robots import RobotSpec
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import rotation_exp
from ocplanner.settings import require

_STREAM = 0x705E
"""Keeps the draws apart from those that the episode's seed makes elsewhere."""


@dataclass(frozen=True)
class PoseError:
    """How wrong an estimator is.

    Raises:
        InvalidValueError: a number is negative or not finite.
    """

    position_mm: float = 0.0
    """Standard deviation of the position along each axis of the world, millimetres."""
    rotation_deg: float = 0.0
    """Standard deviation of the angle by which the rotation is off, about an axis of any direction, degrees."""
    latency_steps: int = 0
    """Age of an estimate when it is read, control steps (0.05 s)."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name, value in (("position", self.position_mm), ("rotation", self.rotation_deg)):
            right = isfinite(value) and value >= 0
            require(right, f"the pose noise in {name} is {value}, but must be finite and not negative")
        late = self.latency_steps
        require(late >= 0, f"the pose latency is {late} steps, but must not be negative")

    def disturb(self, pose: Pose, rng: np.random.Generator) -> Pose:
        """A pose with the noise of one estimate."""
        shift, axis, angle = rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal()
        turn = np.radians(self.rotation_deg) * angle * axis / np.linalg.norm(axis)
        position = pose.position + self.position_mm / 1000 * shift
        return Pose(position, rotation_exp(turn) @ pose.rotation)


class NoisyPoseCell:
    """A work cell whose object poses come from an imperfect estimator; the arms' joints and fingers are exact.

    There is one estimate of each object a control step, however often it is read, with noise of its own. The first one
    is read until it is as old as the latency. Each object has a stream of draws for the whole episode, which depends on
    the seed and the object's place in ``names`` alone: a larger error is the same one enlarged.

    Args:
        cell: the work cell, its episode just begun.
        names: of its objects.
        error: how wrong.
        seed: of the episode.
    """

    def __init__(self, cell: WorkCell, names: Sequence[str], error: PoseError, seed: int) -> None:
        self._cell, self._error = cell, error
        self._rngs = {name: np.random.default_rng([_STREAM, seed, number]) for number, name in enumerate(names)}
        self._estimates = {name: deque[Pose](maxlen=error.latency_steps + 1) for name in names}
        self._estimate()

    def _estimate(self) -> None:
        for name, rng in self._rngs.items():
            self._estimates[name].append(self._error.disturb(self._cell.object_pose(name), rng))

    def step(self, action: np.ndarray) -> None:
        """One control step of all arms, and the estimates after it."""
        self._cell.step(action)
        self._estimate()

    def object_pose(self, name: str) -> Pose:
        """The newest estimate that has come through."""
        return self._estimates[name][0]

    @property
    def robot(self) -> RobotSpec:
        """The cell's own."""
        return self._cell.robot

    @property
    def arms(self) -> Sequence[CellArm]:
        """The cell's own."""
        return self._cell.arms
