"""A rigid pose as two arrays; the maths lives in :mod:`ocplanner._core`."""

from typing import NamedTuple

import numpy as np


class Pose(NamedTuple):
    """Pose of a body in robosuite's world frame.

    Attributes:
        position: (3,) float64, metres.
        rotation: (3, 3) float64, row-major, body -> world.
    """

    position: np.ndarray
    rotation: np.ndarray

    def __matmul__(self, other: "Pose") -> "Pose":
        """Composition ``self * other`` of SE(3) elements."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    def raised(self, height: float) -> "Pose":
        """The pose moved up along the world's z, metres."""
        return self._replace(position=self.position + np.array([0.0, 0.0, height]))

    def inverse(self) -> "Pose":
        """The inverse transform."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)
