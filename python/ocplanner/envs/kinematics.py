"""Inverse kinematics of an arm's end-effector site: damped least squares from several starts."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ocplanner.envs.simulator import mujoco, robosuite
from ocplanner.geometry.pose import Pose

_DAMPING = 0.03
_MAX_STEP_RAD = 0.3
_ITERATIONS = 80
_STALLED_AFTER = 10
_PROGRESS_M = 2e-4
_CLOSE_POSITION_M = 5e-4
_CLOSE_ROTATION_RAD = 5e-3
ROTATION_WEIGHT_M = 0.1
"""How many metres of position error one radian of rotation error counts for."""
RESERVE_M = 0.02
"""Reach that must be left at a pose for the arm to be able to move there."""
RESERVE_RAD = 0.05
"""Distance from the joints' limits that must be left at a pose."""


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

    @classmethod
    def of(cls, robot: Any, model: Any) -> "ArmJoints":
        """Of robosuite's robot, in its compiled model."""
        joints = np.array([model.joint(name).id for name in robot.robot_joints])
        limited = model.jnt_limited[joints].astype(bool)
        return cls(
            qpos=np.array(robot._ref_joint_pos_indexes),
            dofs=np.array(robot._ref_joint_vel_indexes),
            lower=np.where(limited, model.jnt_range[joints, 0], -2 * np.pi),
            upper=np.where(limited, model.jnt_range[joints, 1], 2 * np.pi),
            home=np.array(robot.init_qpos, dtype=np.float64),
            site=int(robot.eef_site_id[robot.arms[0]]),
        )


def home_posture(robot: str) -> np.ndarray:
    """(n,) robosuite's starting posture of an arm without its noise, radians."""
    models = robosuite.models.robots.robot_model.REGISTERED_ROBOTS
    return np.array(models[robot].init_qpos.fget(None), dtype=np.float64)


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


class Reach:
    """Foretells how near an arm gets to poses of its hand, from the posture that it has, without moving it.

    Args:
        model: the compiled model.
        data: its state, which is only read.
        arm: the arm's joints.
    """

    def __init__(self, model: Any, data: Any, arm: ArmJoints) -> None:
        self._model, self._data = model, data
        self._arm = replace(arm, lower=arm.lower + RESERVE_RAD, upper=arm.upper - RESERVE_RAD)
        self._first = int(model.dof_jntid[arm.dofs[0]])

    @cached_property
    def _scratch(self) -> Any:
        """A state of the model to try postures in; many environments never need it."""
        return mujoco.MjData(self._model)

    @property
    def base(self) -> np.ndarray:
        """(3,) place of the arm's first joint, world, metres."""
        return self._data.xanchor[self._first].copy()

    def outward(self, position: np.ndarray) -> np.ndarray:
        """(3,) horizontal unit vector from the arm's first joint to a position in the world."""
        outward = position - self.base
        outward[2] = 0.0
        return outward / max(float(np.linalg.norm(outward)), RESERVE_M)

    def reach_error(self, pose: Pose) -> float:
        """The error that is left when the end-effector site is led to a pose of the world frame.

        The pose is pushed outward by :data:`RESERVE_M`, and the joints' limits are drawn in by :data:`RESERVE_RAD`: an
        arm whose elbow is all but straight or that has come to a limit is there, and cannot move. Only the present
        posture is a start: a controller gets to no other solution.

        Returns:
            The error in metres, a radian counted as 0.1 m.
        """
        return self._go(Pose(pose.position + RESERVE_M * self.outward(pose.position), pose.rotation))

    def wrist_room(self, pose: Pose, turn: float) -> float:
        """How far the last joint is within its limits, radians, after turning a hand that points down.

        Args:
            pose: of the end-effector site before the turn, world frame.
            turn: about the world's z, radians.
        """
        self._go(pose)
        last = self._arm.qpos[-1]
        axis = self._scratch.xaxis[self._model.dof_jntid[self._arm.dofs[-1]]]
        turned = float(self._scratch.qpos[last] + np.sign(axis[2]) * turn)
        return min(turned - float(self._arm.lower[-1]), float(self._arm.upper[-1]) - turned)

    def _go(self, pose: Pose) -> float:
        self._scratch.qpos[:] = self._data.qpos
        start = self._data.qpos[self._arm.qpos].copy()
        return reach(self._model, self._scratch, self._arm, pose, [start], _CLOSE_POSITION_M)


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
