"""Errors of plans against what the demonstrator did: distances in millimetres, angles in degrees."""

from dataclasses import asdict, dataclass

import numpy as np

from ocplanner.geometry.rotation import angles_between

NEAR_END = 20
"""Frames at the end of a demonstration, in which the object is placed."""


@dataclass(frozen=True)
class PlanErrors:
    """Errors of N plans against N true futures.

    ADE is the mean distance over the horizon, FDE the distance at its last step. ``path_mm`` is the mean distance from
    each planned point to the nearest point of the true future, which ignores timing. Rotation errors are means over the
    horizon; ``yaw90`` treats turns of 90 degrees about the vertical as equal. ``end_*`` counts only the last 20 kept
    frames of each demonstration, ``end_fde_xy_mm`` only horizontal distances. Angles are None for planners of
    positions.
    """

    frames: int
    ade_mm: float
    fde_mm: float
    path_mm: float
    end_ade_mm: float
    end_fde_mm: float
    end_fde_xy_mm: float
    rotation_deg: float | None = None
    rotation_median_deg: float | None = None
    final_rotation_deg: float | None = None
    yaw_deg: float | None = None
    yaw90_deg: float | None = None
    yaw_wrong_percent: float | None = None
    """Plans whose last yaw is more than 45 degrees off."""
    end_rotation_deg: float | None = None

    def as_row(self) -> dict[str, float]:
        """The values that are not None, for ``metrics.jsonl``."""
        return {name: float(value) for name, value in asdict(self).items() if value is not None}


def yaw_angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed turn about the vertical in radians, (-pi, pi], that takes (..., 3, 3) ``a``'s x axis to ``b``'s."""
    yaw_a, yaw_b = (np.arctan2(r[..., 1, 0], r[..., 0, 0]) for r in (a, b))
    difference = yaw_b - yaw_a
    return np.arctan2(np.sin(difference), np.cos(difference))


def fold(angle: np.ndarray, period: float) -> np.ndarray:
    """Distance in radians from ``angle`` to the nearest multiple of ``period``."""
    return np.abs((angle + period / 2) % period - period / 2)


def plan_errors(
    positions: np.ndarray,
    true_positions: np.ndarray,
    rotations: np.ndarray | None,
    true_rotations: np.ndarray,
    remaining: np.ndarray,
) -> PlanErrors:
    """Errors of plans.

    Args:
        positions: (N, H, 3) planned, metres.
        true_positions: (N, H, 3).
        rotations: (N, H, 3, 3) planned, or None.
        true_rotations: (N, H, 3, 3).
        remaining: (N,) frames until each demonstration's kept segment ends.
    """
    distance = np.linalg.norm(positions - true_positions, axis=-1) * 1000
    gaps = np.linalg.norm(positions[:, :, None] - true_positions[:, None], axis=-1)
    path = gaps.min(axis=2).mean() * 1000
    end = remaining <= NEAR_END
    end = end if end.any() else np.ones(len(remaining), bool)
    final_xy = np.linalg.norm((positions - true_positions)[:, -1, :2], axis=-1) * 1000
    errors = PlanErrors(
        frames=len(positions),
        ade_mm=distance.mean(),
        fde_mm=distance[:, -1].mean(),
        path_mm=path,
        end_ade_mm=distance[end].mean(),
        end_fde_mm=distance[end, -1].mean(),
        end_fde_xy_mm=final_xy[end].mean(),
    )
    if rotations is None:
        return errors
    angle = np.degrees(angles_between(rotations, true_rotations.astype(np.float64)))
    yaw = yaw_angle(rotations, true_rotations)
    return PlanErrors(
        **{name: value for name, value in asdict(errors).items() if value is not None},
        rotation_deg=angle.mean(),
        rotation_median_deg=float(np.median(angle.mean(axis=1))),
        final_rotation_deg=angle[:, -1].mean(),
        yaw_deg=np.degrees(np.abs(yaw)).mean(),
        yaw90_deg=np.degrees(fold(yaw, np.pi / 2)).mean(),
        yaw_wrong_percent=100 * (np.abs(yaw[:, -1]) > np.pi / 4).mean(),
        end_rotation_deg=angle[end].mean(),
    )
