"""Types of the native module; the arrays are NumPy views on the way in and owned arrays on the way out."""

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

_F64: TypeAlias = NDArray[np.float64]
_Pose: TypeAlias = tuple[_F64, _F64]

def rotation_from_6d(rot6d: _F64) -> _F64:
    """(..., 6) columns a1, a2 (Zhou et al. 2019) -> (..., 3, 3) rotations.

    Raises:
        InvalidValueError: a column is zero, not finite, or parallel to the other.
        ShapeError: wrong shape, dtype or memory order; so do all functions below.
    """

def rotation_to_6d(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 6), their first two columns."""

def rotation_from_quat_xyzw(quat_xyzw: _F64) -> _F64:
    """(..., 4) quaternions x, y, z, w of any length but zero -> (..., 3, 3) rotations."""

def quat_xyzw_from_rotation(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 4) unit quaternions x, y, z, w with w >= 0."""

def rotation_from_quat_wxyz(quat_wxyz: _F64) -> _F64:
    """(..., 4) quaternions w, x, y, z of any length but zero -> (..., 3, 3) rotations."""

def quat_wxyz_from_rotation(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 4) unit quaternions w, x, y, z with w >= 0."""

def rotation_log(rotation: _F64) -> _F64:
    """(..., 3, 3) rotations -> (..., 3) rotation vectors, axis times angle in [0, pi] rad."""

def rotation_exp(vector: _F64) -> _F64:
    """(..., 3) rotation vectors, axis times angle in rad -> (..., 3, 3) rotations."""

def geodesic_angle(a: _F64, b: _F64) -> _F64:
    """Angles in [0, pi] rad between rotations of the same shape (..., 3, 3)."""

def compose_poses(pose_a_b: _Pose, pose_b_c: _Pose) -> _Pose:
    """``pose_a_c``; a pose is a (3,) position in m and a (3, 3) rotation."""

def invert_pose(pose_a_b: _Pose) -> _Pose:
    """``pose_b_a``."""

class PlannerEngine:
    """Forward pass of a planner file; safe to call from several threads at once."""

    def __new__(cls, data: bytes, storage: Literal["f32", "bf16"] = "f32") -> PlannerEngine:
        """Load the bytes of a planner file, keeping the weights as float32 or rounded to bfloat16.

        Raises:
            PlannerFileError: the bytes are damaged, or are no planner.
        """

    @property
    def config_json(self) -> str:
        """The file's whole configuration."""

    def plan(
        self, images: list[NDArray[np.uint8]], all_modes: bool = False, threads: int = 1
    ) -> tuple[_F64, _F64 | None, _F64]:
        """Plan from one (B, size, size, 3) uint8 array per camera, in the configuration's order.

        Returns:
            positions (B, H, 3) in m, rotations (B, H, 3, 3) or None, probabilities (B,); with ``all_modes`` each has
            a second axis of modes.
        """

    def encode(self, images: list[NDArray[np.uint8]], threads: int = 1) -> NDArray[np.float32]:
        """Latent means (B, latent) of the most probable modes."""

def simd_level() -> Literal["avx512", "avx2", "portable"]:
    """The instruction set in use; ``OCPLANNER_SIMD`` asks for a lower one before the first planner is loaded."""
