"""The low-dimensional observations that robomimic's data sets hold, from a live environment."""

import numpy as np

from ocplanner.demos.layouts import ORDERS, TASK_OBJECTS, Order
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.envs.simulator import mujoco
from ocplanner.errors import MismatchError, UnknownNameError
from ocplanner.geometry.pose import Pose


def recorded_observation(env: ManipulationEnv, order: Order | None = None) -> dict[str, np.ndarray]:
    """What a recording would hold at this moment, without the one step by which robosuite 1.5 lags.

    Args:
        env: the environment.
        order: of ``object`` in the data set; without it ``object`` is left out.

    Returns:
        ``robot0_eef_pos`` (3,) in m, ``robot0_eef_quat`` (4,) xyzw, ``robot0_gripper_qpos`` (joints of the gripper,)
        and ``object`` (14 an object): absolute position and quaternion xyzw, and both relative to the end effector, in
        the given order; float64, world frame.

    Raises:
        MismatchError: ``object`` of this task is laid out in another way.
        UnknownNameError: no such order.
    """
    robot, data = env.robosuite_env.robots[0], env.data
    arm = robot.arms[0]
    position = env.eef_pose().position
    quat = _xyzw(data.xquat[env.model.body(robot.robot_model.eef_name[arm]).id])
    found = {
        "robot0_eef_pos": position,
        "robot0_eef_quat": quat,
        "robot0_gripper_qpos": data.qpos[robot._ref_gripper_joint_pos_indexes[arm]],
    }
    return found if order is None else {**found, "object": _objects(env, order, position, quat)}


def _objects(env: ManipulationEnv, order: Order, eef_position: np.ndarray, eef_quat: np.ndarray) -> np.ndarray:
    if order not in ORDERS:
        raise UnknownNameError("order of the object observation", order, ORDERS)
    task = TASK_OBJECTS[env.task.env_name]
    if not task.relative:
        raise MismatchError(
            f"the observation `object` of {env.task.name} differs between robosuite's versions and cannot be made "
            "live; train the policy with other observations (--low-dim)"
        )
    hand = Pose(eef_position, _rotation(eef_quat)).inverse()
    blocks = []
    for name in task.objects:
        pose = env.object_pose(name)
        relative = hand @ pose
        body = env.model.jnt_bodyid[env.model.joint(env.task.object(name).joint).id]
        # Signs of the quaternions as robosuite has them: MuJoCo's own of the absolute, w >= 0 in the relative.
        absolute_first = [pose.position, _xyzw(env.data.xquat[body]), relative.position, _quat(relative.rotation)]
        blocks += absolute_first if order == "absolute-first" else [*absolute_first[2:], *absolute_first[:2]]
    return np.concatenate(blocks)


def _rotation(quat_xyzw: np.ndarray) -> np.ndarray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.roll(quat_xyzw, 1))
    return matrix.reshape(3, 3)


def _quat(rotation: np.ndarray) -> np.ndarray:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation).ravel())
    return _xyzw(-quat if quat[0] < 0 else quat)


def _xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    return np.roll(quat_wxyz, -1)
