"""The delta-pose law in plain NumPy, as it would be written without the native module."""

import numpy as np

_LIMIT_POSITION, _SCALE_POSITION = 0.05, 0.05
_LIMIT_ROTATION, _SCALE_ROTATION = 0.2, 0.5

Pose = tuple[np.ndarray, np.ndarray]


def delta_pose_action(
    pose_object: Pose, pose_target: Pose, pose_eef: Pose, rotation_world_base: np.ndarray
) -> np.ndarray:
    """The (6,) action of ``ocplanner._core.delta_pose_action`` with its default law.

    A pose is a (3,) position in metres and a (3, 3) rotation, world frame; the action is in the base frame.
    """
    position_object, rotation_object = pose_object
    position_target, rotation_target = pose_target
    position_eef, _ = pose_eef
    turn = rotation_target @ rotation_object.T
    goal = position_target + turn @ (position_eef - position_object)
    delta_pos_base = rotation_world_base.T @ (goal - position_eef)
    delta_rot_base = rotation_world_base.T @ _rotation_vector(turn)
    horizontal = np.linalg.norm(delta_pos_base[:2])
    if horizontal > _LIMIT_POSITION:
        delta_pos_base[:2] *= _LIMIT_POSITION / horizontal
    delta_pos_base[2] = np.clip(delta_pos_base[2], -_LIMIT_POSITION, _LIMIT_POSITION)
    angle = np.linalg.norm(delta_rot_base)
    if angle > _LIMIT_ROTATION:
        delta_rot_base *= _LIMIT_ROTATION / angle
    action = np.concatenate([delta_pos_base / _SCALE_POSITION, delta_rot_base / _SCALE_ROTATION])
    return np.clip(action, -1.0, 1.0)


def _rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Axis times angle, for angles below pi."""
    angle = np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1.0, 1.0))
    if angle < 1e-9:
        return np.zeros(3)
    skew = rotation - rotation.T
    return angle / (2 * np.sin(angle)) * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
