"""Where an object's pose stands inside robomimic's flat ``object`` observation.

robosuite concatenates all object sensors into one vector. Up to 1.4.1 the absolute pose of a nut or can came first,
from 1.5 on the pose relative to the end effector does; both are 14 numbers, so mixing them up goes unnoticed. The
order is therefore voted on by the recording's ``env_version`` and, independently, by the numbers themselves.

Quaternions are xyzw in observations and wxyz in simulator states. The relative pose is that of the object in the end
effector's frame (``robot0_eef_pos``, ``robot0_eef_quat``).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ocplanner.errors import ObjectLayoutError, UnknownNameError

Order = Literal["absolute-first", "relative-first"]
ORDERS: tuple[Order, Order] = ("absolute-first", "relative-first")

# Two estimates of one pose agree when their medians over the steps differ by less than this: recordings agree to
# 1e-6, robosuite 1.5 lags by one control step (a few mm and hundredths of a radian), wrong orders are off by 0.1-1.
_AGREE_POSITION = 0.01  # m
_AGREE_ROTATION = 0.05  # 1 - |q.q'|


@dataclass(frozen=True)
class TaskObjects:
    """What the ``object`` vector of one robosuite environment holds.

    Attributes:
        task: the name of the task in ocplanner and in the literature.
        objects: sensor prefixes (``SquareNut``), in the order of their blocks.
        relative: per object a 14-number block with the relative pose, in either order; otherwise the vector begins
            with one (position, quaternion) pair per object, followed by ``trailing`` other numbers.
        trailing: numbers after the poses when ``relative`` is false.
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


def rotation_from_quat_xyzw(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3), body -> world, of quaternions (..., 4) in xyzw order; normalises them.

    Raises:
        ObjectLayoutError: a quaternion is zero or not finite.
    """
    norm = np.linalg.norm(quat_xyzw, axis=-1, keepdims=True)
    if not np.all(np.isfinite(norm)) or np.any(norm < 1e-6):
        raise ObjectLayoutError("an object quaternion is zero or not finite; the `object` observation is damaged")
    x, y, z, w = np.moveaxis(quat_xyzw / norm, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def split_object(object_state: np.ndarray, env_name: str, object_name: str, order: Order) -> np.ndarray:
    """The absolute pose of one object, (T, 7): world position (m), quaternion xyzw.

    Raises:
        UnknownNameError: the environment holds no such object.
        ObjectLayoutError: the environment is unknown or the width is not the one it records.
    """
    task = _task_objects(object_state, env_name)
    if object_name not in task.objects:
        raise UnknownNameError(f"object of {env_name}", object_name, task.objects)
    index = task.objects.index(object_name)
    start = 7 * index
    if task.relative:
        start = 14 * index + (0 if order == "absolute-first" else 7)
    return object_state[:, start : start + 7]


def order_from_version(env_version: str | None) -> Order | None:
    """The order that a robosuite version writes; None when the version is missing or unreadable."""
    numbers = re.match(r"v?(\d+)\.(\d+)", env_version or "")
    if numbers is None:
        return None
    return "absolute-first" if (int(numbers[1]), int(numbers[2])) < (1, 5) else "relative-first"


def order_from_relative_pose(block: np.ndarray, eef_pos: np.ndarray, eef_quat_xyzw: np.ndarray) -> Order | None:
    """The order in which the one half of a 14-number block is the other as the end effector sees it.

    Args:
        block: (T, 14), two poses as position and quaternion xyzw.
        eef_pos: (T, 3) metres, world.
        eef_quat_xyzw: (T, 4).

    Returns:
        None when neither order fits, or both do.
    """
    rotation_eef = rotation_from_quat_xyzw(eef_quat_xyzw)
    first, second = block[:, :7], block[:, 7:]
    fits = [
        _is_relative(absolute, relative, eef_pos, rotation_eef)
        for absolute, relative in ((first, second), (second, first))
    ]
    return ORDERS[fits.index(True)] if sum(fits) == 1 else None


def find_in_states(pose_xyzw: np.ndarray, states: np.ndarray, tolerance: float = 1e-3) -> int | None:
    """The column of ``states`` (T, D) at which a free joint holds this pose (T, 7) as xyz and wxyz; None if nowhere."""
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
    """The order of an ``object`` observation, from every witness there is; they must not contradict each other.

    Witnesses: the recording's version (or ``stated``, which replaces it), the relative pose recomputed from the end
    effector, and the simulator states, in one of whose free joints the absolute pose must be found.

    Args:
        object_state: (T, D).
        env_name: robosuite's name of the environment, such as ``NutAssemblySquare``.
        env_version: robosuite's version at recording, or None.
        eef_pos: (T, 3) or None.
        eef_quat_xyzw: (T, 4) or None.
        states: (T, S) or None.
        stated: the order that the user says it is.

    Raises:
        ObjectLayoutError: witnesses contradict each other, or there is none.
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
            f"the order of the {object_state.shape[1]} numbers in `object` of {env_name} cannot be told: env_version "
            f"is {env_version!r}, and neither states nor an end-effector pose settle it; "
            "say it with object_layout='absolute-first' (robosuite up to 1.4.1) or 'relative-first' (from 1.5)"
        )
    said = "; ".join(f"{witness} says {order}" for witness, order in cast.items())
    raise ObjectLayoutError(
        f"the order of `object` of {env_name} is contradictory: {said}. If the numbers were extracted by another "
        "robosuite version than env_version says, correct env_version or state object_layout yourself"
    )


def _task_objects(object_state: np.ndarray, env_name: str) -> TaskObjects:
    task = TASK_OBJECTS.get(env_name)
    if task is None:
        known = ", ".join(sorted(TASK_OBJECTS))
        raise ObjectLayoutError(f"the layout of `object` is not known for environment {env_name!r}; known: {known}")
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
    # The first observation after a reset may hold zeros (robosuite 1.5): the medians do not see it.
    norm = np.linalg.norm(relative[:, 3:], axis=1, keepdims=True)
    rotation_relative = rotation_from_quat_xyzw(np.where(norm < 1e-6, [0.0, 0.0, 0.0, 1.0], relative[:, 3:]))
    expected = np.einsum("tji,tjk->tik", rotation_eef, rotation_from_quat_xyzw(absolute[:, 3:]))
    cosine = (np.einsum("tij,tij->t", expected, rotation_relative) - 1) / 2
    return bool(np.median(1 - cosine) < _AGREE_ROTATION)


def _states_message(task: TaskObjects, what: str) -> str:
    return (
        f"`object` does not belong to `states`: {what} of {task.objects[0]}'s block is in no free joint of the states. "
        "The file is damaged or its observations were extracted from other states; extract them again with "
        "robomimic's dataset_states_to_obs.py"
    )
