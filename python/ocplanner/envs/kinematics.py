"""Inverse kinematics of an arm's end-effector site: damped least squares from several starts."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ocplanner.envs.simulator import mujoco
from ocplanner.pose import Pose

_DAMPING = 0.03
_MAX_STEP_RAD = 0.3
_ITERATIONS = 80
_STALLED_AFTER = 10
_PROGRESS_M = 2e-4
_CLOSE_POSITION_M = 5e-4
_CLOSE_ROTATION_RAD = 5e-3
ROTATION_WEIGHT_M = 0.1
"""How many metres of position error one radian of rotation error counts for."""


@dataclass(frozen=True)
class ArmJoints:
    """The arm's joints and the site that they carry.

    Attributes:
        qpos: (n,) addresses in ``qpos``.
        dofs: (n,) addresses in ``qvel``.
        lower: (n,) joint limits, radians.
        upper: (n,) joint limits, radians.
        home: (n,) robosuite's starting posture without its noise, radians.
        site: id of the end-effector site.
    """

    qpos: np.ndarray
    dofs: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    home: np.ndarray
    site: int


def site_pose(data: Any, site: int) -> Pose:
    """Pose of a site in the world."""
    return Pose(data.site_xpos[site].copy(), data.site_xmat[site].reshape(3, 3).copy())


def pose_error(pose: Pose, target: Pose) -> np.ndarray:
    """(6,) difference to the target: metres, then the rotation vector in the world frame, radians."""
    quat, rotation = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quat, (target.rotation @ pose.rotation.T).flatten())
    mujoco.mju_quat2Vel(rotation, quat, 1.0)
    return np.concatenate([target.position - pose.position, rotation])


def reach(model: Any, data: Any, arm: ArmJoints, target: Pose, starts: list[np.ndarray], tolerance: float) -> float:
    """Move the arm's joints so that its site comes closest to a pose.

    Only ``data.qpos`` and what depends on it through kinematics is changed.

    Args:
        model: the compiled model.
        data: its state.
        arm: which joints may move.
        target: wanted pose of the site, world frame.
        starts: (n,) postures to start from, tried in order until one arrives.
        tolerance: an error below this is an arrival, metres.

    Returns:
        The remaining error in metres, rotation counted with :data:`ROTATION_WEIGHT_M`.
    """
    best, best_error = data.qpos[arm.qpos].copy(), np.inf
    for start in starts:
        posture, error = _descend(model, data, arm, target, start)
        if error < best_error:
            best, best_error = posture, error
        if best_error < tolerance:
            break
    data.qpos[arm.qpos] = best
    return float(best_error)


def _descend(model: Any, data: Any, arm: ArmJoints, target: Pose, start: np.ndarray) -> tuple[np.ndarray, float]:
    posture = np.clip(start, arm.lower, arm.upper)
    jacobian = np.zeros((6, model.nv))
    best, best_error = posture, np.inf
    milestone, since = np.inf, 0
    for _ in range(_ITERATIONS):
        data.qpos[arm.qpos] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        error = pose_error(site_pose(data, arm.site), target)
        distance, angle = np.linalg.norm(error[:3]), np.linalg.norm(error[3:])
        size = float(distance + ROTATION_WEIGHT_M * angle)
        if size < best_error:
            best, best_error = posture, size
        if distance < _CLOSE_POSITION_M and angle < _CLOSE_ROTATION_RAD:
            break
        since += 1
        if best_error < milestone - _PROGRESS_M:
            milestone, since = best_error, 0
        elif since > _STALLED_AFTER:
            break
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], arm.site)
        moving = jacobian[:, arm.dofs]
        gram = moving @ moving.T + _DAMPING**2 * np.eye(6)
        step = moving.T @ np.linalg.solve(gram, error)
        step *= min(1.0, _MAX_STEP_RAD / max(float(np.abs(step).max()), 1e-9))
        posture = np.clip(posture + step, arm.lower, arm.upper)
    return best, best_error
