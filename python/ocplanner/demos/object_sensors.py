"""Which sensors robosuite's flat ``object`` observation is made of, one after the other.

A sensor is named as in robosuite: ``cube_pos`` and ``cube_quat`` (xyzw) are a pose in the world,
``X_to_robot0_eef_pos`` and ``_quat`` the pose of X in the end effector's frame, ``A_to_B`` the vector from A to B in
the world, where ``gripper`` is the end effector. A leading minus negates: the ``gripper_to_cube_pos`` of robosuite 1.4
points from the cube to the gripper, that of 1.5 from the gripper to the cube. Other names are flags, 0 or 1.
"""

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ocplanner.demos.layouts import ORDERS, TASK_OBJECTS, Order, order_from_version
from ocplanner.errors import InvalidValueError, ObjectLayoutError, UnknownNameError
from ocplanner.geometry.rotation import angles_between, quat_xyzw_from_rotation, rotation_from_quat_xyzw

if TYPE_CHECKING:
    from ocplanner.demos.dataset import Demonstrations
    from ocplanner.demos.demonstration import Demonstration

Sensors = tuple[str, ...]
Frame = tuple[np.ndarray, np.ndarray]
"""Positions (T, 3) in metres and rotations (T, 3, 3), frame -> world."""

_HAND = "_to_robot0_eef"
_VECTOR = re.compile(r"-?(\w+?)_to_(\w+?)(?:_pos)?")
# What a recording's own numbers must agree to. robosuite 1.5 records relative poses that are one control step old.
_SAME_VECTOR_M = 1e-3
_SAME_POSITION_M, _SAME_ROTATION_RAD = 0.01, 0.3176
_QUAT = 4  # numbers
_ZERO = 1e-6
_REMEDY = (
    "name the robosuite version that extracted the observations as env_version in env_args, or train without `object` "
    "(--low-dim)"
)


def _blocks(objects: tuple[str, ...], order: Order) -> Sensors:
    """Absolute and relative pose of each object."""
    parts = ("", _HAND) if order == "absolute-first" else (_HAND, "")
    return tuple(f"{name}{part}_{kind}" for name in objects for part in parts for kind in ("pos", "quat"))


def _layouts() -> Mapping[str, Mapping[Order, Sensors]]:
    cubes = ("cubeA_pos", "cubeA_quat", "cubeB_pos", "cubeB_quat")
    grip, between = ("gripper_to_cubeA", "gripper_to_cubeB"), "cubeA_to_cubeB"
    first, second = ORDERS
    hang = {order: _blocks(("base", "frame", "tool"), order) for order in ORDERS}
    found: dict[str, Mapping[Order, Sensors]] = {
        "Lift": {
            first: ("cube_pos", "cube_quat", "-gripper_to_cube_pos"),
            second: ("cube_pos", "cube_quat", "gripper_to_cube_pos"),
        },
        "Stack": {first: (*cubes, *grip, between), second: (*cubes, between, *grip)},
        "ToolHang": {order: (*hang[order], "frame_is_assembled", "tool_on_frame") for order in ORDERS},
    }
    for name, objects in TASK_OBJECTS.items():
        if objects.relative:
            found[name] = {order: _blocks(objects.objects, order) for order in ORDERS}
    return found


OBJECT_SENSORS: Mapping[str, Mapping[Order, Sensors]] = _layouts()
"""By robosuite's environment: ``absolute-first`` is what robosuite up to 1.4.1 records, ``relative-first`` 1.5."""


def sensors_of(env_name: str, order: Order) -> Sensors:
    """The sensors of an environment's ``object``.

    Raises:
        UnknownNameError: no such order.
        ObjectLayoutError: the environment's ``object`` is not known.
    """
    if order not in ORDERS:
        raise UnknownNameError("order of the object observation", order, ORDERS)
    if env_name not in OBJECT_SENSORS:
        known = ", ".join(sorted(OBJECT_SENSORS))
        raise ObjectLayoutError(
            f"the sensors of `object` are unknown for environment {env_name!r} (known: {known}); "
            "train without `object` (--low-dim)"
        )
    return OBJECT_SENSORS[env_name][order]


def object_order(demos: "Demonstrations", name: str) -> Order:
    """Which robosuite's sensors the ``object`` of a demonstration consists of, checked against its numbers.

    The witnesses are ``env_version`` and the numbers themselves: relative poses and vectors follow from the absolute
    poses and the recorded end effector. They must not contradict each other.

    Raises:
        ObjectLayoutError: the environment is unknown, the vector has another width, or witnesses contradict each other
            or are missing.
        DatasetError: there is no such observation.
    """
    demo, env_name = demos[name], demos.env_name
    if "object" in demo.derived_keys:
        return demo.object_layout() or ORDERS[0]
    known: dict[Order, Sensors] = {order: sensors_of(env_name, order) for order in ORDERS}
    seen, place = demo.observation("object"), f"{demos.path}: {name}/obs/object"
    width = sum(map(_width, known[ORDERS[0]]))
    if seen.ndim != 2 or seen.shape[1] != width:
        raise ObjectLayoutError(
            f"{place} of {env_name} has shape {seen.shape}, expected (steps, {width}); extract the observations again "
            "with robomimic's dataset_states_to_obs.py, or train without `object` (--low-dim)"
        )
    if env_name in TASK_OBJECTS:
        order = demo.object_layout()  # compares the poses with the states too
        if order is not None and TASK_OBJECTS[env_name].relative:
            return order
    said, fitting = order_from_version(demos.env_version), _fitting(demo, seen, known)
    if fitting is None:
        found = said
    elif said is None:
        found = fitting[0] if len(fitting) == 1 else None
    else:
        found = said if said in fitting else None
    if found is None:
        fault = "one that does not settle them" if fitting is None else f"they fit {' and '.join(fitting) or 'neither'}"
        raise ObjectLayoutError(
            f"{place}: whether its numbers are in the order of robosuite up to 1.4.1 (absolute-first) or from 1.5 "
            f"(relative-first) is unclear: env_version is {demos.env_version!r}, and by robot0_eef_pos {fault}; "
            f"{_REMEDY}"
        )
    return found


def rearranged(seen: np.ndarray, found: Sensors, wanted: Sensors) -> np.ndarray:
    """``object`` (T, D) with the sensors ``found``, as the one with the sensors ``wanted`` of the same environment."""
    columns = sensor_columns(seen, found)
    values = {sensor.lstrip("-"): (-part if sensor.startswith("-") else part) for sensor, part in columns.items()}
    parts = (-values[sensor[1:]] if sensor.startswith("-") else values[sensor] for sensor in wanted)
    return np.concatenate(list(parts), axis=1)


def computed(sensor: str, frame: Callable[[str], Frame]) -> np.ndarray:
    """(T, 3) or (T, 4): a relative pose or a vector from the frames that it relates.

    Args:
        sensor: its name.
        frame: gives the frame of an object by name, and of ``gripper``, the end effector.
    """
    body, relative, kind = sensor.partition(_HAND)
    if relative:
        (position, rotation), (hand, turned) = frame(body), frame("gripper")
        if kind == "_pos":
            return np.einsum("tji,tj->ti", turned, position - hand)
        return quat_xyzw_from_rotation(np.einsum("tji,tjk->tik", turned, rotation))
    ends = _VECTOR.fullmatch(sensor)
    if ends is None:
        raise UnknownNameError("sensor", sensor, ("X_pos", "X_quat", f"X{_HAND}_pos", f"X{_HAND}_quat", "A_to_B"))
    vector = frame(ends[2])[0] - frame(ends[1])[0]
    return -vector if sensor.startswith("-") else vector


def is_computed(sensor: str) -> bool:
    """Whether a sensor relates two frames, and is neither a pose in the world nor a flag."""
    return "_to_" in sensor


def _fitting(demo: "Demonstration", seen: np.ndarray, known: Mapping[Order, Sensors]) -> list[Order] | None:
    """The orders in which the numbers are consistent; None without a recorded end effector."""
    if not {"robot0_eef_pos", "robot0_eef_quat"} <= {*demo.observation_keys}:
        return None
    hand = (demo.eef_positions, demo.observation("robot0_eef_quat"))
    try:
        return [order for order, sensors in known.items() if _consistent(sensor_columns(seen, sensors), *hand)]
    except InvalidValueError as error:
        raise ObjectLayoutError(f"{demo!r}: obs/robot0_eef_quat: {error}; {_REMEDY}") from error


def _consistent(columns: Mapping[str, np.ndarray], eef_pos: np.ndarray, eef_quat: np.ndarray) -> bool:
    def frame(name: str) -> Frame:
        if name == "gripper":
            return eef_pos, _rotations(eef_quat)
        return columns[f"{name}_pos"], _rotations(
            columns.get(f"{name}_quat", np.tile([0.0, 0, 0, 1], (len(eef_pos), 1)))
        )

    for sensor, recorded in columns.items():
        if not is_computed(sensor):
            continue
        expected = computed(sensor, frame)
        if recorded.shape[1] == _QUAT:
            off = np.median(angles_between(_rotations(expected), _rotations(recorded))) / _SAME_ROTATION_RAD
        elif _HAND in sensor:
            off = np.median(np.linalg.norm(expected - recorded, axis=1)) / _SAME_POSITION_M
        else:
            off = np.quantile(np.linalg.norm(expected - recorded, axis=1), 0.95) / _SAME_VECTOR_M
        if not off < 1:
            return False
    return True


def sensor_columns(seen: np.ndarray, sensors: Sensors) -> dict[str, np.ndarray]:
    """``object`` (T, D) cut into its sensors, each (T, 1 to 4) float64."""
    ends = np.cumsum([_width(sensor) for sensor in sensors])
    return dict(zip(sensors, np.split(np.asarray(seen, dtype=np.float64), ends[:-1], axis=1)))


def _width(sensor: str) -> int:
    if sensor.endswith("_quat"):
        return _QUAT
    return 3 if is_computed(sensor) or sensor.endswith("_pos") else 1


def _rotations(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotations (T, 3, 3); a wrong order puts positions here, and 1.5's first reading is zero: those are no turn."""
    quat = np.array(quat_xyzw, dtype=np.float64)
    quat[np.linalg.norm(quat, axis=1) < _ZERO] = [0.0, 0.0, 0.0, 1.0]
    return rotation_from_quat_xyzw(quat)
