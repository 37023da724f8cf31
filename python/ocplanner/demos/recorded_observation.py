"""The low-dimensional observations of robomimic's data sets, from a live environment."""

import numpy as np

from ocplanner.demos.layouts import Order
from ocplanner.demos.object_sensors import Frame, Sensors, computed, is_computed, sensors_of
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.geometry.rotation import quat_xyzw_from_rotation

HAND_KEYS: tuple[str, ...] = ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
"""What :func:`recorded_observation` gives of every task, beside ``object``."""

_PLACES = {("ToolHang", "base"): ("geom", "stand_base"), ("ToolHang", "frame"): ("site", "frame_intersection_site")}
"""Sensors' frames that are no bodies, by environment and name."""
_FLAGS = {"frame_is_assembled": "_check_frame_assembled", "tool_on_frame": "_check_tool_on_frame"}


def recorded_observation(env: ManipulationEnv, layout: Order | Sensors | None = None) -> dict[str, np.ndarray]:
    """What a recording would contain at this moment, without robosuite 1.5's lag of one step.

    Args:
        env: the environment.
        layout: of ``object`` in the data set: the names of its sensors, or ``absolute-first`` for those of robosuite up
            to 1.4.1 and ``relative-first`` for those of 1.5; if None, ``object`` is left out.

    Returns:
        ``robot0_eef_pos`` (3,) in m, ``robot0_eef_quat`` (4,) xyzw, ``robot0_gripper_qpos`` (joints of the gripper,),
        and ``object``, the sensors one after the other (see :mod:`ocplanner.demos.object_sensors`); float64, world
        frame.

    Raises:
        ObjectLayoutError: this task's ``object`` is not known.
        UnknownNameError: no such order, or no such sensor.
    """
    robot, data = env.robosuite_env.robots[0], env.data
    arm = robot.arms[0]
    body = env.model.body(robot.robot_model.eef_name[arm]).id
    hand = (env.eef_pose().position, _xyzw(data.xquat[body]), data.qpos[robot._ref_gripper_joint_pos_indexes[arm]])
    found = dict(zip(HAND_KEYS, hand))
    if layout is None:
        return found
    sensors = sensors_of(env.task.env_name, layout) if isinstance(layout, str) else layout
    # robosuite combines the site's position with the body's rotation.
    gripper: Frame = (hand[0][None], data.xmat[body].reshape(1, 3, 3))
    return {**found, "object": np.concatenate([_read(env, sensor, gripper) for sensor in sensors])}


def _read(env: ManipulationEnv, sensor: str, gripper: Frame) -> np.ndarray:
    if sensor in _FLAGS:
        return np.array([float(getattr(env.robosuite_env, _FLAGS[sensor])())])
    if is_computed(sensor):
        return computed(sensor, lambda name: gripper if name == "gripper" else _frame(env, name))[0]
    name, _, kind = sensor.rpartition("_")
    position, rotation = _frame(env, name)
    if kind == "pos":
        return position[0]
    # The quaternions' signs are robosuite's: MuJoCo's own where it reads one, w >= 0 where it converts a rotation.
    if env.task.env_name == "ToolHang":
        return quat_xyzw_from_rotation(rotation)[0]
    return _xyzw(env.data.xquat[_place(env, name)[1]])


def _frame(env: ManipulationEnv, name: str) -> Frame:
    kind, number = _place(env, name)
    prefix = "x" if kind == "body" else f"{kind}_x"
    position, rotation = (getattr(env.data, f"{prefix}{part}")[number] for part in ("pos", "mat"))
    return position.copy()[None], rotation.reshape(1, 3, 3).copy()


def _place(env: ManipulationEnv, name: str) -> tuple[str, int]:
    """What a sensor's frame is attached to, ``body``, ``geom`` or ``site``, and its number."""
    root = "root" if env.task.env_name == "ToolHang" else "main"
    kind, place = _PLACES.get((env.task.env_name, name), ("body", f"{name}_{root}"))
    return kind, int(getattr(env.model, kind)(place).id)


def _xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    return np.roll(quat_wxyz, -1)
