"""The low-dimensional observations of robomimic's data sets, from a live environment."""

import numpy as np

from ocplanner.demos.layouts import ORDERS, TASK_OBJECTS, Order
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import MismatchError, UnknownNameError
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import quat_xyzw_from_rotation


def recorded_observation(env: ManipulationEnv, order: Order | None = None) -> dict[str, np.ndarray]:
    """What a recording would contain at this moment, without robosuite 1.5's lag of one step.

    Args:
        env: the environment.
        order: of ``object`` in the data set; if None, ``object`` is left out.

    Returns:
        ``robot0_eef_pos`` (3,) in m, ``robot0_eef_quat`` (4,) xyzw, ``robot0_gripper_qpos`` (joints of the gripper,),
        and ``object`` (14 an object): the absolute pose and the pose relative to the end effector, in the given order,
        each as position and quaternion xyzw; float64, world frame.

    Raises:
        MismatchError: this task's ``object`` has another layout.
        UnknownNameError: no such order.
    """
    robot, data = env.robosuite_env.robots[0], env.data
    arm = robot.arms[0]
    body = env.model.body(robot.robot_model.eef_name[arm]).id
    found = {
        "robot0_eef_pos": env.eef_pose().position,
        "robot0_eef_quat": _xyzw(data.xquat[body]),
        "robot0_gripper_qpos": data.qpos[robot._ref_gripper_joint_pos_indexes[arm]],
    }
    if order is None:
        return found
    # robosuite combines the site's position with the body's rotation.
    hand = Pose(env.eef_pose().position, data.xmat[body].reshape(3, 3))
    return {**found, "object": _objects(env, order, hand)}


def _objects(env: ManipulationEnv, order: Order, hand: Pose) -> np.ndarray:
    if order not in ORDERS:
        raise UnknownNameError("order of the object observation", order, ORDERS)
    task = TASK_OBJECTS[env.task.env_name]
    if not task.relative:
        raise MismatchError(
            f"the observation `object` of {env.task.name} differs between robosuite versions and cannot be computed "
            "live; train the policy with other observations (--low-dim)"
        )
    blocks = []
    for name in task.objects:
        pose = env.object_pose(name)
        relative = hand.inverse() @ pose
        body = env.model.jnt_bodyid[env.model.joint(env.task.object(name).joint).id]
        # The quaternions' signs are robosuite's: MuJoCo's own in the absolute pose, w >= 0 in the relative one.
        absolute_half = [pose.position, _xyzw(env.data.xquat[body])]
        relative_half = [relative.position, quat_xyzw_from_rotation(relative.rotation)]
        halves = (absolute_half, relative_half) if order == "absolute-first" else (relative_half, absolute_half)
        blocks += [*halves[0], *halves[1]]
    return np.concatenate(blocks)


def _xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    return np.roll(quat_wxyz, -1)
