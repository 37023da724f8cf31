"""Rotations, quaternions, rotation vectors and 6D: the one place for each.

Rotations are (..., 3, 3) float64, body -> world. The functions of :mod:`ocplanner._core` take any leading axes.
"""

import numpy as np

from ocplanner import _core

quat_wxyz_from_rotation = _core.quat_wxyz_from_rotation
quat_xyzw_from_rotation = _core.quat_xyzw_from_rotation
rotation_exp = _core.rotation_exp
rotation_from_6d = _core.rotation_from_6d
rotation_from_quat_wxyz = _core.rotation_from_quat_wxyz
rotation_from_quat_xyzw = _core.rotation_from_quat_xyzw
rotation_log = _core.rotation_log
rotation_to_6d = _core.rotation_to_6d


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (...) between rotations of the same shape (..., 3, 3), radians in [0, pi]."""
    return _core.geodesic_angle(np.ascontiguousarray(a), np.ascontiguousarray(b))


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two rotations (3, 3), radians in [0, pi]."""
    return float(angles_between(a, b))


def yaw_rotation(angle: float) -> np.ndarray:
    """(3, 3) rotation about z, radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def mean_rotation(rotations: np.ndarray) -> np.ndarray:
    """Chordal mean of rotations (N, 3, 3): the rotation nearest to their average."""
    u, _, vt = np.linalg.svd(np.mean(rotations, axis=0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
