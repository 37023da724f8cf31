"""One demonstration of a file, read lazily."""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import h5py
import numpy as np

from ocplanner.demos.derived import DERIVED_ORDER, DerivedObservations
from ocplanner.demos.layouts import Order, detect_order, split_object
from ocplanner.demos.recorded_task import carriers, object_of, part_gripper, recorded_task, segment_rule
from ocplanner.demos.segments import Segment, manipulation_segment
from ocplanner.errors import DatasetError, InvalidValueError, ObjectLayoutError
from ocplanner.files.hdf5 import HDF5File
from ocplanner.geometry.rotation import rotation_from_quat_xyzw

_STATE_DIMS = 2
_UNNAMED = ("object", "robot0_eef_pos", "robot1_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
"""What files store of every task; they have an object's pose in ``object`` or under its name."""


class Recording(NamedTuple):
    """What the demonstrations of one file share.

    Attributes:
        env_name: robosuite's name of the environment.
        env_version: robosuite's version at recording, or None.
        action_width: expected length of an action; None if the file does not say.
        object_layout: the order of ``object`` that the user stated, or None.
        names: our names of observations -> the file's, where they differ.
        raw: whether it is a raw recording of robosuite.
        clipped: whether the controller clipped the actions to [-1, 1].
        derived: what derives observations from the states; None if it cannot be done.
    """

    env_name: str
    env_version: str | None
    action_width: int | None
    object_layout: Order | None
    names: Mapping[str, str] = MappingProxyType({})
    raw: bool = False
    clipped: bool = False
    derived: DerivedObservations | None = None


class Demonstration:
    """One demonstration. Every property reads the file when it is used; only names and the length are kept.

    Attributes:
        name: such as ``demo_3``.
    """

    def __init__(self, file: HDF5File, recording: Recording, name: str) -> None:
        self._file = file
        self._recording = recording
        self.name = name

    def __repr__(self) -> str:
        """Name and file."""
        return f"Demonstration({self.name!r} of {str(self._file.path)!r})"

    def __len__(self) -> int:
        """Number of steps."""
        return self.length

    @cached_property
    def length(self) -> int:
        """Number of steps T."""
        return self._file.shape(self._key("actions"))[0] - self._late

    @property
    def attrs(self) -> dict[str, Any]:
        """All attributes as stored: ``num_samples``, ``model_file`` (the recorded MuJoCo XML), ..."""
        return self._file.attributes(f"data/{self.name}")

    @property
    def model_file(self) -> str | None:
        """The recorded MuJoCo model (XML), or what else stands for it; None if nothing does."""
        found = self.attrs.get("model_file")
        return None if found is None else str(found)

    @property
    def states(self) -> np.ndarray:
        """(T, D) flattened simulator states, each before its row's action; free joints as xyz and wxyz.

        robosuite up to 1.0 recorded them after the action: they are moved to the next one, and the first action, whose
        state is missing, is left out.
        """
        return self._finite("states", dims=2)

    @property
    def actions(self) -> np.ndarray:
        """(T, 7 arms) normalised OSC_POSE actions; the last of each arm's 7 is the gripper's (-1 opens, 1 closes).

        Outside [-1, 1] they are clipped, as robosuite's controllers for deltas did.
        """
        actions = self.recorded_actions
        return np.clip(actions, -1.0, 1.0) if self._recording.clipped else actions

    @property
    def recorded_actions(self) -> np.ndarray:
        """:attr:`actions` before any clipping."""
        actions = self._finite("actions", dims=2)
        actions = actions.astype(np.float64) if actions.dtype.kind == "b" else actions
        width = self._recording.action_width
        if width is not None and actions.shape[1] != width:
            raise self._error("actions", f"shape {actions.shape}, expected (steps, {width})", "record it again")
        return actions

    @property
    def recorded_late(self) -> bool:
        """Whether each state was recorded after its action."""
        return self._late > 0

    @cached_property
    def _late(self) -> int:
        """1 if each state was recorded after its action (robosuite up to 1.0), else 0.

        The first state then has the time of one step, not that of the reset. Later versions recorded it before; a file
        of theirs that begins later was cut.
        """
        if not self._recording.raw or not self.has_states:
            return 0
        times = self._file.read(self._key("states"), slice(0, 2))[:, 0]
        old = re.match(r"v?(0\.|1\.0(\.|$))", self._recording.env_version or "") is not None
        return int(old and len(times) == 2 and 0.5 < times[0] / max(times[1] - times[0], 1e-9) < 1.5)

    @cached_property
    def has_states(self) -> bool:
        """Whether there is a table of simulator states."""
        key = self._key("states")
        return "states" in self._file.names(f"data/{self.name}") and len(self._file.shape(key)) == _STATE_DIMS

    @property
    def rewards(self) -> np.ndarray:
        """(T,) reward of the state after each action; if not recorded, 1 where the simulated task is solved, else 0.

        The state after the last action is not recorded: the last one stands for it.
        """
        if self._lacks("rewards"):
            success = self._derive()["success"].astype(np.float64)
            return np.append(success[1:], success[-1:])
        return self._finite("rewards", dims=1)

    @property
    def dones(self) -> np.ndarray:
        """(T,), 1 where the episode ends after the action; if not recorded, only at the last one."""
        if self._lacks("dones"):
            return (np.arange(self.length) == self.length - 1).astype(np.int64)
        return self._read("dones", dims=1)

    @cached_property
    def stored_keys(self) -> tuple[str, ...]:
        """The names under ``obs`` in the file; empty if there are none."""
        return self._file.names(self._key("obs"))

    @cached_property
    def derived_keys(self) -> tuple[str, ...]:
        """The names of observations that are not stored but derived from the states.

        Poses by name are not, if ``object`` is stored.
        """
        derived = self._recording.derived
        if derived is None or not self.has_states:
            return ()
        stored = {*self.stored_keys, *self._recording.names}
        by_name = "object" not in stored
        return tuple(key for key in derived.keys if key not in stored and (by_name or key in _UNNAMED))

    @cached_property
    def observation_keys(self) -> tuple[str, ...]:
        """The names of the observations, stored and derived ones."""
        known = {*self.stored_keys, *self.derived_keys}
        known |= {ours for ours, theirs in self._recording.names.items() if theirs in known}
        return tuple(sorted(known))

    def stored_hand(self, arm: int) -> np.ndarray | None:
        """:meth:`hand_positions` if they are stored, not derived; else None."""
        key = f"robot{arm}_eef_pos"
        return self.hand_positions(arm) if key in self.observation_keys and key not in self.derived_keys else None

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras with images (``obs/<camera>_image``)."""
        return tuple(key.removesuffix("_image") for key in self.observation_keys if key.endswith("_image"))

    @cached_property
    def next_observation_keys(self) -> tuple[str, ...]:
        """The names under ``next_obs``, ours where they are mapped; empty if there are none."""
        stored = {*self._file.names(self._key("next_obs"))}
        return tuple(sorted(stored | {ours for ours, theirs in self._recording.names.items() if theirs in stored}))

    def observation(self, key: str, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """``obs/<key>`` as stored, (T, ...), or some of its rows (an index array must increase).

        Raises:
            DatasetError: no such observation; the message lists the known ones.
        """
        return self._observed("obs", self.observation_keys, key, rows)

    def next_observation(self, key: str, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """``next_obs/<key>`` as stored, (T, ...), or some of its rows (an index array must increase).

        Raises:
            DatasetError: no such observation; the message lists the known ones.
        """
        return self._observed("next_obs", self.next_observation_keys, key, rows)

    def images(self, camera: str, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """(T, h, w, 3) uint8, upright.

        Raises:
            DatasetError: no images of this camera; the message tells how to render them.
        """
        key = f"{camera}_image"
        if key not in self.observation_keys:
            cameras = ", ".join(self.cameras) or "none"
            remedy = f"add them with `ocplanner render` (cameras with images: {cameras})"
            raise self._error(f"obs/{key}", f"no images of camera {camera!r}", remedy)
        images = self.observation(key, rows)
        if images.dtype != np.uint8 or images.ndim != 4 or images.shape[-1] != 3:
            found = f"{images.dtype} {images.shape}, expected uint8 (steps, height, width, 3)"
            raise self._error(f"obs/{key}", found, "render the images again with `ocplanner render`")
        return images

    @property
    def array_paths(self) -> tuple[str, ...]:
        """The paths of all stored arrays: ``actions``, ``obs/object``, ..."""
        return self._file.arrays(f"data/{self.name}")

    @property
    def eef_positions(self) -> np.ndarray:
        """(T, 3) end-effector (site) positions of the first robot, world, metres."""
        return self.hand_positions(0)

    def hand_positions(self, arm: int) -> np.ndarray:
        """(T, 3) end-effector (site) positions of the robot with this number, world, metres."""
        return self._numbers(f"robot{arm}_eef_pos")

    def carrier_actions(self, part: str) -> np.ndarray:
        """(T,) the gripper's action of the hand that carries an object; see :func:`part_gripper`."""
        arms = range(1 + max(carriers(self._recording.env_name, object_of(part))))
        return part_gripper(self.gripper_actions(arms), self._recording.env_name, part)

    def gripper_actions(self, arms: Sequence[int] = (0,)) -> np.ndarray:
        """(T, n) the joint command to each of n grippers: above 0 closes, below 0 opens.

        Args:
            arms: numbers of the robots.

        Raises:
            DatasetError: the recording has fewer arms.
        """
        actions = self.actions
        width = 7 if actions.shape[1] % 7 == 0 else actions.shape[1]  # one arm under another controller than OSC_POSE
        columns = [width * (arm + 1) - 1 for arm in arms]
        if max(columns) >= actions.shape[1]:
            fault = f"shape {actions.shape}, too few for arm {max(arms)}"
            raise self._error("actions", fault, "record it with as many arms as the task needs")
        return actions[:, columns]

    def object_layout(self) -> Order | None:
        """The detected order of ``object``; None if the file has no such observation.

        Raises:
            ObjectLayoutError: the order cannot be determined, or the evidence is contradictory.
        """
        keys = self.observation_keys
        if "object" not in keys:
            return None
        if "object" in self.derived_keys:
            return DERIVED_ORDER
        has_eef = {"robot0_eef_pos", "robot0_eef_quat"} <= set(keys)
        try:
            return detect_order(
                self._numbers("object"),
                self._recording.env_name,
                env_version=self._recording.env_version,
                eef_pos=self._numbers("robot0_eef_pos") if has_eef else None,
                eef_quat_xyzw=self._numbers("robot0_eef_quat") if has_eef else None,
                states=self.states if self.has_states else None,
                stated=self._recording.object_layout,
            )
        except ObjectLayoutError as error:
            raise ObjectLayoutError(f"{self._file.path}: {self._key('obs')}: {error}") from error
        except InvalidValueError as error:
            raise self._damaged_object(error) from error

    def object_poses(self, object_name: str) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, 3) in metres and rotations (T, 3, 3), object -> world, for any layout of the file.

        They come from named sensors (``obs/SquareNut_pos``, ``obs/SquareNut_quat``) if the file has them, else from
        ``obs/object``.

        Args:
            object_name: the object, or a part of what arms do with it (``payload:0``).

        Raises:
            ObjectLayoutError: the layout cannot be determined or contradicts the states.
            UnknownNameError: the task has no such object.
            DatasetError: the file has no pose of it, or a quaternion is zero.
        """
        keys, object_name = self.observation_keys, object_of(object_name)
        if {f"{object_name}_pos", f"{object_name}_quat"} <= set(keys):
            parts = [self._numbers(f"{object_name}_{part}") for part in ("pos", "quat")]
            widths = tuple(part.shape[1] for part in parts)
            if widths != (3, 4):
                fault = f"position and quaternion have widths {widths}, expected (3, 4)"
                raise self._error(f"obs/{object_name}_pos", fault, "record it again")
            pose = np.concatenate(parts, axis=1)
        else:
            order = self.object_layout()
            if order is None:
                remedy = (
                    f"name the key that holds it (--keys), or record states (the file has: {', '.join(keys) or 'none'})"
                )
                raise self._error("obs/object", f"no pose of {object_name} in this file", remedy)
            pose = split_object(self.observation("object"), self._recording.env_name, object_name, order)
        try:
            rotations = rotation_from_quat_xyzw(np.ascontiguousarray(pose[:, 3:], dtype=np.float64))
        except InvalidValueError as error:
            raise self._damaged_object(error) from error
        return pose[:, :3].astype(np.float64), rotations

    def manipulation(self, part: str | None = None) -> Segment:
        """The kept steps of an object: those in which it is manipulated, under its task's own rule.

        See :func:`ocplanner.demos.recorded_task.segment_rule` and
        :func:`ocplanner.demos.segments.manipulation_segment`.

        Args:
            part: an object, or what one arm does with it (``payload:0``); the task's first object if not given.

        Raises:
            DatasetError: the object is never manipulated, or its pose or the gripper's actions cannot be read.
        """
        part = self.object_names[0] if part is None else part
        rule = segment_rule(self._recording.env_name, part)
        return manipulation_segment(*self.object_poses(part), self.carrier_actions(part), rule)

    @property
    def object_names(self) -> tuple[str, ...]:
        """The objects whose poses the task records; empty for an unknown task."""
        task = recorded_task(self._recording.env_name)
        return () if task is None else task.objects

    def arrays(self) -> dict[str, np.ndarray]:
        """All stored arrays of the demonstration by path (``actions``, ``obs/object``, ...), for a copy.

        Those of a raw recording are as :attr:`states` and :attr:`actions` give them.
        """
        paths = self._file.arrays(f"data/{self.name}")
        if not self._recording.raw:
            return {path: self._file.read(self._key(path)) for path in paths}
        own = {"actions": self.actions, "states": self.states if self.has_states else None}
        return {path: array for path in paths if (array := own[path] if path in own else self._read(path)) is not None}

    def digest(self) -> str:
        """SHA-256 of what the file stores of it and how that is read; of pictures every eighth counts."""
        told = [self.attrs, dict(self._recording.names), self._recording.object_layout]
        digest = hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode())
        for path in sorted(self._file.arrays(f"data/{self.name}")):
            shape = self._file.shape(self._key(path))
            rows = slice(None) if len(shape) < 3 else np.unique([*range(0, shape[0], 8), shape[0] - 1])
            array = self._file.read(self._key(path), rows) if 0 not in shape else np.empty(shape)
            digest.update(f"{path} {array.dtype} {shape}".encode())
            digest.update(repr(array.tolist()).encode() if array.dtype.hasobject else np.ascontiguousarray(array).data)
        return digest.hexdigest()

    def copy_to(self, target: h5py.Group, name: str) -> None:
        """Copy it with its attributes to another open file, without unpacking compressed data."""
        self._file.copy(f"data/{self.name}", target, name)
        if self._recording.raw:
            group = target.require_group(name)
            for path, array in self.arrays().items():
                del group[path]
                group.create_dataset(path, data=array)

    def _key(self, key: str) -> str:
        return f"data/{self.name}/{key}"

    def _lacks(self, key: str) -> bool:
        """Whether an array is not stored, but can be derived."""
        derivable = self._recording.derived is not None and self.has_states
        return derivable and key not in self._file.names(f"data/{self.name}")

    def _derive(self) -> dict[str, np.ndarray]:
        derived = self._recording.derived
        if derived is None:
            raise self._error("states", "of an unknown task or robot", "record env_args with it")
        return derived.of(self)

    def _observed(self, group: str, known: tuple[str, ...], key: str, rows: slice | np.ndarray) -> np.ndarray:
        if key not in known:
            remedy = f"the file has: {', '.join(known) or 'none'}"
            raise self._error(f"{group}/{key}", "no such observation", remedy)
        if group == "obs" and key in self.derived_keys:
            return self._derive()[key][rows]
        return self._read(f"{group}/{self._recording.names.get(key, key)}", rows=rows)

    def _numbers(self, key: str) -> np.ndarray:
        """(T, n) finite numbers of ``obs/<key>``, stored or derived."""
        if key in self.derived_keys:
            return self._derive()[key]
        return self._finite(f"obs/{self._recording.names.get(key, key)}", dims=2)

    def _read(self, key: str, dims: int | None = None, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        steps = self.length + self._late

        def check(shape: tuple[int, ...]) -> None:
            if dims is not None and len(shape) != dims:
                raise self._error(key, f"shape {shape}, expected {dims} dimension(s)", "record it again")
            if shape[:1] != (steps,):
                raise self._error(key, f"shape {shape}, but there are {steps} actions", "record it again")

        if not self._late:
            return self._file.read(self._key(key), rows, check)
        array = self._file.read(self._key(key), slice(None), check)
        return (array[1:] if key == "actions" else array[:-1])[rows]

    def _finite(self, key: str, dims: int) -> np.ndarray:
        array = self._read(key, dims)
        if array.dtype.kind not in "fiub":
            raise self._error(key, f"dtype {array.dtype}, expected numbers", "record it again")
        if not np.all(np.isfinite(array)):
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            remedy = "leave the demonstration out (--skip-bad) or record it again"
            raise self._error(key, f"{array[place]} at {list(place)}", remedy)
        return array

    def _error(self, key: str, fault: str, remedy: str) -> DatasetError:
        return self._file.error(self._key(key), fault, remedy)

    def _damaged_object(self, error: InvalidValueError) -> DatasetError:
        remedy = "extract the observations again with robomimic's dataset_states_to_obs.py"
        return self._error("obs", f"an object's pose is damaged ({error})", remedy)
