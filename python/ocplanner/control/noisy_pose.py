"""Object poses as an imperfect estimator gives them: noisy, and late."""

from collections import deque
from dataclasses import dataclass
from math import isfinite

import numpy as np

from ocplanner.control.arm import Arm
from ocplanner.errors import InvalidValueError
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import rotation_exp

_STREAM = 0x705E
"""Keeps the draws apart from those that the episode's seed makes elsewhere."""


@dataclass(frozen=True)
class PoseError:
    """How wrong an estimator is.

    Attributes:
        position_mm: standard deviation of the position along each axis of the world, millimetres.
        rotation_deg: standard deviation of the angle by which the rotation is off, about an axis of any direction,
            degrees.
        latency_steps: age of an estimate when it is read, control steps (0.05 s).

    Raises:
        InvalidValueError: one is negative or not finite.
    """

    position_mm: float = 0.0
    rotation_deg: float = 0.0
    latency_steps: int = 0

    def __post_init__(self) -> None:
        """Check the values."""
        for name, value in (("position", self.position_mm), ("rotation", self.rotation_deg)):
            if not (isfinite(value) and value >= 0):
                raise InvalidValueError(f"the pose noise in {name} is {value}, but must be finite and not negative")
        if self.latency_steps < 0:
            raise InvalidValueError(f"the pose latency is {self.latency_steps} steps, but must not be negative")

    @property
    def labels(self) -> tuple[str, ...]:
        """For file names, such as ``("noise5mm2deg", "latency2")``; empty without an error."""
        labels = []
        if self.position_mm or self.rotation_deg:
            labels.append(f"noise{self.position_mm:g}mm{self.rotation_deg:g}deg")
        if self.latency_steps:
            labels.append(f"latency{self.latency_steps}")
        return tuple(labels)

    def disturb(self, pose: Pose, rng: np.random.Generator) -> Pose:
        """A pose with the noise of one estimate."""
        shift, axis, angle = rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal()
        turn = np.radians(self.rotation_deg) * angle * axis / np.linalg.norm(axis)
        position = pose.position + self.position_mm / 1000 * shift
        return Pose(position, rotation_exp(turn) @ pose.rotation)


def parse_noise(text: str) -> tuple[float, float]:
    """``"5,2"`` -> (5.0, 2.0): millimetres and degrees.

    Raises:
        InvalidValueError: it is not two numbers.
    """
    try:
        millimetres, degrees = (float(number) for number in text.split(","))
    except ValueError as error:
        raise InvalidValueError(
            f"pose noise is {text!r}, but must be MM,DEG: two numbers with a comma, such as 5,2"
        ) from error
    return millimetres, degrees


class NoisyPoseArm:
    """An arm whose program reads the object's pose from an imperfect estimator; its own joints and fingers are exact.

    There is one estimate a control step, however often it is read, with noise of its own. The first one is read until
    it is as old as the latency. The draws depend on the seed alone: a larger error is the same one enlarged.

    Args:
        arm: the arm, its episode just begun.
        error: how wrong.
        seed: of the episode.
    """

    def __init__(self, arm: Arm, error: PoseError, seed: int) -> None:
        self._arm, self._error = arm, error
        self._rng = np.random.default_rng([_STREAM, seed])
        self._estimates: deque[Pose] = deque(maxlen=error.latency_steps + 1)
        self._estimate()

    def _estimate(self) -> None:
        self._estimates.append(self._error.disturb(self._arm.object_pose(), self._rng))

    def step(self, action: np.ndarray) -> None:
        """One control step of the arm, and the estimate after it."""
        self._arm.step(action)
        self._estimate()

    def object_pose(self) -> Pose:
        """The newest estimate that has come through."""
        return self._estimates[0]

    def eef_pose(self) -> Pose:
        """The arm's own, exact."""
        return self._arm.eef_pose()

    @property
    def base_rotation(self) -> np.ndarray:
        """The arm's own."""
        return self._arm.base_rotation

    @property
    def gripper_opening(self) -> float:
        """The arm's own."""
        return self._arm.gripper_opening
