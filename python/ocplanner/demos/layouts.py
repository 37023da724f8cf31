"""Where an object's pose is inside robomimic's flat ``object`` observation.

robosuite concatenates all object sensors into one vector. Up to 1.4.1 the absolute pose of a nut or can comes first,
from 1.5 on the pose relative to the end effector. Both have 14 numbers, so a mistake goes unnoticed. The order is
therefore voted on by the recording's ``env_version`` and, independently, by the numbers themselves.

Quaternions are xyzw in observations and wxyz in simulator states. The relative pose is that of the object in the end
effector's frame (``robot0_eef_pos``, ``robot0_eef_quat``).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocplanner.errors import ObjectLayoutError, UnknownNameError
from ocplanner.geometry.rotation import angles_between, rotation_from_quat_xyzw

Order = Literal["absolute-first", "relative-first"]
ORDERS: tuple[Order, Order] = ("absolute-first", "relative-first")

# Two estimates of one pose agree if their median difference over the steps is below this. Recordings agree to 1e-6,
# robosuite 1.5 lags by one control step (a few mm and hundredths of a radian), wrong orders are off by 0.1 to 1.
_AGREE_POSITION = 0.01  # m
_AGREE_ROTATION = 0.3176  # rad


@dataclass(frozen=True)
class TaskObjects:
    """The contents of the ``object`` vector of one robosuite environment.

    Attributes:
        task: the name of the task in ocplanner and in the literature.
        objects: sensor prefixes (``SquareNut``), in the order of their blocks.
        relative: whether each object has a block of 14 numbers, its absolute and its relative pose in either order.
            Otherwise the vector begins with position and quaternion of each object, and ``trailing`` other numbers
            follow.
        trailing: numbers after the poses if ``relative`` is false.
    """

    task: str
    objects: tuple[str, ...]
    relative: bool
    trailing: int = 0

    @property
    def width(self) -> int:
        """Length of the ``object`` vector."""
        return 14 * len(self.objects) if self.relative else 7 * len(self.objects) + self.trailing


TASK_OBJECTS: Mapping[str, TaskObjects] = {
    "NutAssemblySquare": TaskObjects("Square", ("SquareNut",), relative=True),
    "NutAssemblyRound": TaskObjects("Round", ("RoundNut",), relative=True),
    "NutAssembly": TaskObjects("NutAssembly", ("SquareNut", "RoundNut"), relative=True),
    "PickPlaceCan": TaskObjects("Can", ("Can",), relative=True),
    "PickPlaceMilk": TaskObjects("Milk", ("Milk",), relative=True),
    "PickPlaceBread": TaskObjects("Bread", ("Bread",), relative=True),
    "PickPlaceCereal": TaskObjects("Cereal", ("Cereal",), relative=True),
    "Lift": TaskObjects("Lift", ("cube",), relative=False, trailing=3),
    "Stack": TaskObjects("Stack", ("cubeA", "cubeB"), relative=False, trailing=9),
}


def split_object(object_state: np.ndarray, env_name: str, object_name: str, order: Order) -> np.ndarray:
    """The absolute pose of one object, (T, 7): world position (m), quaternion xyzw.

    Raises:
        UnknownNameError: the environment holds no such object.
        ObjectLayoutError: the environment is unknown, or the vector has another width.
    """
    task = _task_objects(object_state, env_name)
    if object_name not in task.objects:
        raise UnknownNameError(f"object of {env_name}", object_name, task.objects)
    index = task.objects.index(object_name)
    start = 7 * index
    if task.relative:
        start = 14 * index + (0 if order == "absolute-first" else 7)
    return object_state[:, start : start + 7]


def is_from_1_5(env_version: str | None) -> bool | None:
    """Whether a version of robosuite is 1.5 or later; None if it is missing or unreadable."""
    numbers = re.match(r"v?(\d+)\.(\d+)", env_version or "")
    return None if numbers is None else (int(numbers[1]), int(numbers[2])) >= (1, 5)


def order_from_version(env_version: str | None) -> Order | None:
    """The order that a version of robosuite writes; None if the version is missing or unreadable."""
    modern = is_from_1_5(env_version)
    return None if modern is None else ORDERS[modern]


def order_from_relative_pose(block: np.ndarray, eef_pos: np.ndarray, eef_quat_xyzw: np.ndarray) -> Order | None:
    """The order in which one half of a 14-number block is the other half relative to the end effector.

    Args:
        block: (T, 14), two poses as position and quaternion xyzw.
        eef_pos: (T, 3) metres, world.
        eef_quat_xyzw: (T, 4).

    Returns:
        None if neither order fits, or both do.
    """
    rotation_eef = _rotations(eef_quat_xyzw)
    first, second = block[:, :7], block[:, 7:]
    fits = [
        _is_relative(absolute, relative, eef_pos, rotation_eef)
        for absolute, relative in ((first, second), (second, first))
    ]
    return ORDERS[fits.index(True)] if sum(fits) == 1 else None


def find_in_states(pose_xyzw: np.ndarray, states: np.ndarray, tolerance: float = 1e-3) -> int | None:
    """The column of ``states`` (T, D) where a free joint has this pose (T, 7), as xyz and wxyz; or None."""
    steps = min(len(states), len(pose_xyzw))
    rows = np.unique(np.linspace(0, steps - 1, min(steps, 64), dtype=int))
    pose, states = pose_xyzw[rows], states[rows]
    if states.shape[1] < pose.shape[1]:
        return None
    positions = np.lib.stride_tricks.sliding_window_view(states[:, :-4], 3, axis=1)
    position_off = np.abs(positions - pose[:, None, :3]).max(axis=2)
    quat_wxyz = pose[:, [6, 3, 4, 5]]
    for column in np.flatnonzero(np.median(position_off, axis=0) <= tolerance):
        dot = np.abs(np.sum(states[:, column + 3 : column + 7] * quat_wxyz, axis=1))
        if np.median(np.abs(dot - 1)) < tolerance:
            return int(column)
    return None


def detect_order(
    object_state: np.ndarray,
    env_name: str,
    *,
    env_version: str | None,
    eef_pos: np.ndarray | None = None,
    eef_quat_xyzw: np.ndarray | None = None,
    states: np.ndarray | None = None,
    stated: Order | None = None,
) -> Order:
    """The order of an ``object`` observation, from all available witnesses, which must not contradict each other.

    Witnesses are the recording's version (or ``stated``, which replaces it), the relative pose recomputed from the end
    effector, and the simulator states, one of whose free joints must have the absolute pose.

    Args:
        object_state: (T, D).
        env_name: robosuite's name of the environment, such as ``NutAssemblySquare``.
        env_version: robosuite's version at recording, or None.
        eef_pos: (T, 3) or None.
        eef_quat_xyzw: (T, 4) or None.
        states: (T, S) or None.
        stated: the order that the user states.

    Raises:
        ObjectLayoutError: witnesses contradict each other, or there is none.
        InvalidValueError: a quaternion is zero.
    """
    task = _task_objects(object_state, env_name)
    if not task.relative:
        pose = object_state[:, :7]
        if states is not None and find_in_states(pose, states) is None:
            raise ObjectLayoutError(_states_message(task, "the pose"))
        return "absolute-first"

    block = object_state[:, :14]
    said_by = f"env_version {env_version!r}" if stated is None else "the stated object layout"
    votes: dict[str, Order | None] = {}
    votes[said_by] = order_from_version(env_version) if stated is None else stated
    if eef_pos is not None and eef_quat_xyzw is not None:
        votes["the relative pose"] = order_from_relative_pose(block, eef_pos, eef_quat_xyzw)
    if states is not None:
        halves: tuple[tuple[Order, np.ndarray], ...] = (
            ("absolute-first", block[:, :7]),
            ("relative-first", block[:, 7:]),
        )
        found: list[Order] = [order for order, half in halves if find_in_states(half, states) is not None]
        if not found:
            raise ObjectLayoutError(_states_message(task, "either half"))
        votes["states"] = found[0] if len(found) == 1 else None
    cast = {witness: order for witness, order in votes.items() if order is not None}
    for order in ORDERS:
        if set(cast.values()) == {order}:
            return order
    if not cast:
        raise ObjectLayoutError(
            f"the order of the {object_state.shape[1]} numbers in `object` of {env_name} is unknown: env_version is "
            f"{env_version!r}, and neither states nor an end-effector pose settle it; state it with "
            "object_layout='absolute-first' (robosuite up to 1.4.1) or 'relative-first' (from 1.5)"
        )
    said = "; ".join(f"{witness} says {order}" for witness, order in cast.items())
    raise ObjectLayoutError(
        f"the order of `object` of {env_name} is contradictory: {said}. If another robosuite version than env_version "
        "extracted the numbers, correct env_version or state object_layout"
    )


def _task_objects(object_state: np.ndarray, env_name: str) -> TaskObjects:
    task = TASK_OBJECTS.get(env_name)
    if task is None:
        known = ", ".join(sorted(TASK_OBJECTS))
        raise ObjectLayoutError(f"the layout of `object` is unknown for environment {env_name!r}; known: {known}")
    if object_state.ndim != 2 or object_state.shape[1] != task.width:
        raise ObjectLayoutError(
            f"`object` of {env_name} has shape {object_state.shape}, expected (steps, {task.width}); "
            "extract the observations again with robomimic's dataset_states_to_obs.py"
        )
    return task


def _is_relative(absolute: np.ndarray, relative: np.ndarray, eef_pos: np.ndarray, rotation_eef: np.ndarray) -> bool:
    offset = np.einsum("tji,tj->ti", rotation_eef, absolute[:, :3] - eef_pos)
    position_off = np.median(np.linalg.norm(offset - relative[:, :3], axis=1))
    if not position_off < _AGREE_POSITION:
        return False
    # robosuite 1.5 may write zeros in the first observation after a reset; the medians do not see it.
    norm = np.linalg.norm(relative[:, 3:], axis=1, keepdims=True)
    rotation_relative = _rotations(np.where(norm < 1e-6, [0.0, 0.0, 0.0, 1.0], relative[:, 3:]))
    expected = np.einsum("tji,tjk->tik", rotation_eef, _rotations(absolute[:, 3:]))
    return bool(np.median(angles_between(expected, rotation_relative)) < _AGREE_ROTATION)


def _rotations(quat_xyzw: np.ndarray) -> np.ndarray:
    return rotation_from_quat_xyzw(np.ascontiguousarray(quat_xyzw, dtype=np.float64))


def _states_message(task: TaskObjects, what: str) -> str:
    return (
        f"`object` does not belong to `states`: no free joint of the states has {what} of {task.objects[0]}'s block. "
        "The file is damaged, or its observations were extracted from other states; extract them again with "
        "robomimic's dataset_states_to_obs.py"
    )
