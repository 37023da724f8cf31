"""Rotations that serve the goal equally well."""

import numpy as np

from ocplanner.geometry.rotation import angle_between, yaw_rotation

_TURNS = 8


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
