"""Reading HDF5 files of demonstrations: robomimic's of all versions, robosuite's own recordings, and other robots'."""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar, overload

from ocplanner.demos.demonstration import Demonstration, Recording
from ocplanner.demos.derived import DerivedObservations
from ocplanner.demos.layouts import Order
from ocplanner.demos.origin import Kind, controllers, is_absolute, origin_of
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.tasks import Task, task_of_env
from ocplanner.errors import DatasetError, UnknownNameError
from ocplanner.files.hdf5 import HDF5File
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, LabelRecord
from ocplanner.files.records.render import RENDER_ATTRIBUTE, RenderRecord
from ocplanner.files.storage import natural_key

_Record = TypeVar("_Record")

_RECORD_AGAIN = "record or download the data set again"


class Demonstrations(Sequence[Demonstration]):
    """The demonstrations of one file, read lazily.

    robomimic's files, with or without observations, and raw recordings of robosuite's ``collect_human_demonstrations``
    read alike: what they lack is derived from their states in the simulator. A file that does not say its task and
    robot (a real one's) gives what it holds.

    Each process opens the file for itself, so an instance can be pickled and used after a fork or a spawn.

    Args:
        path: the HDF5 file.
        object_layout: the order of the flat ``object`` observation, ``absolute-first`` (robosuite up to 1.4.1) or
            ``relative-first`` (from 1.5); None trusts the file's ``env_version``. Both are checked against the data.
        reading: names of observations, and whether bad demonstrations are left out.

    Attributes:
        kind: what recorded the file, see :class:`ocplanner.demos.origin.Origin`.
        env_args: robomimic's description of the environment; empty if the file has none.
        reading: how it is read.

    Raises:
        DatasetError: the file is missing, truncated, or holds no demonstrations.
    """

    def __init__(
        self, path: str | Path, object_layout: Order | None = None, reading: ReadSettings = DEFAULT_READING
    ) -> None:
        self._file = HDF5File(path)
        self.path = self._file.path
        self.reading = reading
        self._derived: DerivedObservations | None = None
        try:
            self.kind: Kind
            self.env_args: dict[str, Any]
            self.kind, self.env_args = origin_of(self._file)
            self.names: tuple[str, ...] = tuple(sorted(self._file.names("data"), key=natural_key))
            self.mask_names: tuple[str, ...] = tuple(sorted(self._file.names("mask")))
            if not self.names:
                raise self._file.error("data", "no demonstration in it", _RECORD_AGAIN)
        except BaseException:
            self.close()
            raise
        self._check_keys()
        self._derived = self._deriving()
        self._recording = Recording(
            self.env_name,
            self.env_version,
            self._action_width(),
            object_layout,
            reading.names,
            raw=self.kind == "robosuite",
            clipped=self._clips(),
            derived=self._derived,
        )

    def _check_keys(self) -> None:
        """Raise if a name that the user gave is nowhere in the file."""
        if self.reading.keys is None:
            return
        stored = {key for name in self.names for key in self._file.names(f"data/{name}/obs")}
        for ours, theirs in self.reading.names.items():
            if theirs not in stored:
                known = ", ".join(sorted(stored)) or "none"
                raise self._file.error(
                    "obs", f"no {theirs}, which {self.reading.keys} gives for {ours}", f"the file has: {known}"
                )

    def close(self) -> None:
        """Close the file and the simulation that observations are derived from; reading afterwards opens them again."""
        self._file.close()
        if self._derived is not None:
            self._derived.close()

    def __enter__(self) -> Self:
        """The file opens when it is first read."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def __repr__(self) -> str:
        """Path, task and size."""
        return f"Demonstrations({str(self.path)!r}: {self.task_name}, {len(self)} demonstrations)"

    def __len__(self) -> int:
        """Number of demonstrations."""
        return len(self.names)

    @overload
    def __getitem__(self, index: int | str) -> Demonstration: ...
    @overload
    def __getitem__(self, index: slice) -> list[Demonstration]: ...
    def __getitem__(self, index: int | str | slice) -> Demonstration | list[Demonstration]:
        """One demonstration by name or by its index in natural order; a list of them for a slice."""
        if isinstance(index, slice):
            return [self[name] for name in self.names[index]]
        if not isinstance(index, str):
            return Demonstration(self._file, self._recording, self.names[index])
        if index not in self.names:
            remedy = f"the file has {len(self)}, from {self.names[0]} to {self.names[-1]}"
            raise self._file.error(f"data/{index}", "no such demonstration", remedy)
        return Demonstration(self._file, self._recording, index)

    def __iter__(self) -> Iterator[Demonstration]:
        """All demonstrations in natural order (demo_2 before demo_10)."""
        return (self[name] for name in self.names)

    def mask(self, name: str) -> list[str]:
        """The names of the demonstrations in ``mask/<name>``, each once, in natural order.

        Raises:
            DatasetError: there is no such mask, or it names missing demonstrations (which ``skip_bad`` leaves out).
        """
        key = f"mask/{name}"
        if name not in self.mask_names:
            known = ", ".join(self.mask_names) or "none"
            raise self._file.error(key, "no such mask", f"the file has: {known}")
        listed = set(self.listed(name))
        absent = sorted(listed - set(self.names), key=natural_key)
        if absent and not self.reading.skip_bad:
            fault = f"it names {', '.join(absent[:3])}, which data does not contain"
            remedy = "correct the mask, or leave out what is missing (--skip-bad)"
            raise self._file.error(key, fault, remedy)
        return sorted(listed & set(self.names), key=natural_key)

    def listed(self, mask: str) -> list[str]:
        """The entries of a mask as they stand, repeated and missing ones too."""
        entries = self._file.read(f"mask/{mask}").ravel().tolist()
        return [entry.decode(errors="replace") if isinstance(entry, bytes) else str(entry) for entry in entries]

    def task(self) -> Task:
        """The recorded task.

        Raises:
            DatasetError: the file does not say its environment.
            UnknownNameError: no task uses that environment.
        """
        self.require_task_named()
        return task_of_env(self.env_name)

    def require_task_named(self) -> None:
        """Check that the file says its environment.

        Raises:
            DatasetError: it does not.
        """
        if not self.env_name:
            raise DatasetError(
                f"{self.path} does not say its task and robot (no env_args in data): only policies can be trained on "
                "it (`ocplanner train-policy --low-dim KEYS`); for everything else record env_args too"
            )

    @property
    def env_name(self) -> str:
        """robosuite's name of the environment, such as ``NutAssemblySquare``; empty if the file does not say."""
        return str(self.env_args.get("env_name", ""))

    @property
    def env_version(self) -> str | None:
        """robosuite's version at recording; None if the file does not say."""
        version = self.env_args.get("env_version")
        return None if version is None else str(version)

    @property
    def task_name(self) -> str:
        """The task's short name (``Square``), or the environment's name for a task that ocplanner does not know."""
        task = recorded_task(self.env_name)
        return self.env_name if task is None else task.name

    @property
    def robots(self) -> tuple[str, ...]:
        """The recorded robots, such as ``("Panda",)``; empty if the file does not say."""
        robots = self.env_kwargs.get("robots") or ()
        if not isinstance(robots, str | list | tuple):
            raise self._file.error("env_args of data", f"robots is {robots!r}, expected names", "correct env_args")
        return (robots,) if isinstance(robots, str) else tuple(str(robot) for robot in robots)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras with images (``obs/<camera>_image``) in the first demonstration."""
        return self[0].cameras

    @property
    def attrs(self) -> dict[str, Any]:
        """The attributes of ``data`` as stored (``env_args``, ``total``, ...)."""
        return self._file.attributes("data")

    @property
    def render_record(self) -> RenderRecord | None:
        """How ``ocplanner render`` drew the images; None if something else did, or there are none."""
        return self._record(RENDER_ATTRIBUTE, RenderRecord.from_json, "render the data set again")

    @property
    def label_record(self) -> LabelRecord | None:
        """How ``ocplanner label`` made the hints and rewards; None if something else did, or there are none."""
        return self._record(LABEL_ATTRIBUTE, LabelRecord.from_json, "label the data set again")

    @property
    def observe(self) -> str:
        """What the images show of the robot: ``"full"`` unless ``ocplanner render`` drew something else."""
        record = self.render_record
        return "full" if record is None else record.observe

    def _record(self, attribute: str, read: Callable[[str], _Record], remedy: str) -> _Record | None:
        text = self.attrs.get(attribute)
        if text is None:
            return None
        try:
            return read(text)
        except (TypeError, ValueError) as error:
            raise self._file.error(f"{attribute} of data", f"cannot be read ({error})", remedy) from error

    @property
    def env_kwargs(self) -> dict[str, Any]:
        """``env_kwargs`` of ``env_args``; empty if the file has none."""
        kwargs = self.env_args.get("env_kwargs")
        return kwargs if isinstance(kwargs, dict) else {}

    @property
    def controllers(self) -> list[str]:
        """Types of the recorded controllers, such as ``OSC_POSE (delta)``; empty if the file does not say."""
        return [
            f"{part['type']} ({'absolute' if is_absolute(part) else 'delta'})"
            for part in controllers(self.env_kwargs.get("controller_configs"))
        ]

    @property
    def grippers(self) -> object:
        """``gripper_types`` of the recording as stored; None if it does not say."""
        return self.env_kwargs.get("gripper_types")

    def compare_world(self, demo: Demonstration) -> None:
        """Compare the world that a demonstration was recorded in with the simulated one, if there is one to simulate.

        Raises:
            DatasetError: the states have another model's size.
            MismatchError: another arm, gripper or scene was recorded.
        """
        if self._derived is not None and demo.has_states:
            self._derived.compare(demo)

    def _deriving(self) -> DerivedObservations | None:
        """What derives observations from states; None if task or robot are not known."""
        task, robots = recorded_task(self.env_name), self.robots
        if task is None or not robots or robots[0] not in ROBOTS or robots != robots[:1] * len(robots):
            return None
        try:
            known = task_of_env(self.env_name)
        except UnknownNameError:
            return None
        return DerivedObservations(known, robots[0], self.grippers)

    def _clips(self) -> bool:
        """Whether a controller clipped the actions to [-1, 1]: robosuite's for deltas do."""
        found = list(controllers(self.env_kwargs.get("controller_configs")))
        return bool(found) and all(str(part["type"]).startswith("OSC") and not is_absolute(part) for part in found)

    def _action_width(self) -> int | None:
        """7 for each arm under OSC_POSE; None if the controller is another one or the file does not say."""
        described = json.dumps(self.env_kwargs.get("controller_configs"))
        one_armed = not {*self.robots} & {"Baxter", "Tiago", "GR1", "SpotWithArm"}
        return 7 * len(self.robots) if self.robots and one_armed and '"OSC_POSE"' in described else None
