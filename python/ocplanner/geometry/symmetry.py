"""Rotations that serve the goal equally well."""

import numpy as np

_TURNS = 8


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two rotations (3, 3), radians in [0, pi]."""
    chord = float(np.linalg.norm(a - b)) / (2 * np.sqrt(2))
    return 2 * float(np.arcsin(min(1.0, chord)))


def yaw_rotation(angle: float) -> np.ndarray:
    """(3, 3) rotation about z, radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def nearest_equivalent(rotation: np.ndarray, reference: np.ndarray, yaw_fold: int) -> np.ndarray:
    """Of the rotations equivalent to ``rotation`` under the goal's symmetry, the nearest to ``reference``.

    Equivalent are ``rotation @ Rz(2 pi k / yaw_fold)``, turns about the object's own z; with ``yaw_fold`` 0 every turn
    about it; with 1 only the rotation itself.

    Args:
        rotation: (3, 3) object -> world.
        reference: (3, 3) object -> world.
        yaw_fold: :attr:`ocplanner.envs.tasks.ObjectSpec.yaw_fold`.
    """
    if yaw_fold == 1:
        return rotation
    # argmin over a of |R Rz(a) - B|_F maximises trace(B^T R Rz(a)) = (M00 + M11) cos a + (M01 - M10) sin a + M22
    m = reference.T @ rotation
    best = np.arctan2(m[0, 1] - m[1, 0], m[0, 0] + m[1, 1])
    if yaw_fold > 1:
        quantum = 2 * np.pi / yaw_fold
        best = quantum * np.round(best / quantum)
    return rotation @ yaw_rotation(best)


def equivalents(rotation: np.ndarray, reference: np.ndarray, yaw_fold: int) -> list[np.ndarray]:
    """The rotations equivalent to ``rotation``, the nearest to ``reference`` first.

    Args:
        rotation: (3, 3) object -> world.
        reference: (3, 3) object -> world.
        yaw_fold: as for :func:`nearest_equivalent`; of the turns that 0 allows, eight are given.
    """
    nearest = nearest_equivalent(rotation, reference, yaw_fold)
    count = yaw_fold or _TURNS
    turned = [nearest @ yaw_rotation(2 * np.pi * step / count) for step in range(count)]
    return sorted(turned, key=lambda other: angle_between(other, reference))


def mean_rotation(rotations: np.ndarray) -> np.ndarray:
    """Chordal mean of rotations (N, 3, 3): the rotation nearest to their average."""
    u, _, vt = np.linalg.svd(np.mean(rotations, axis=0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
