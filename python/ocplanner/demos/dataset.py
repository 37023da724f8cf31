"""Reading robomimic HDF5 files: v0.1, v1.4.1 and v1.5, with or without images, models, masks and next observations."""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar, overload

from ocplanner.demos.demonstration import Demonstration, Recording
from ocplanner.demos.layouts import Order
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.files.hdf5 import HDF5File
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, LabelRecord
from ocplanner.files.records.render import RENDER_ATTRIBUTE, RenderRecord
from ocplanner.files.storage import natural_key

_Record = TypeVar("_Record")

_NOT_ROBOMIMIC = "this is not a robomimic data set: give the path of one"
_RECORD_AGAIN = "record or download the data set again"


class Demonstrations(Sequence[Demonstration]):
    """The demonstrations of one robomimic file, read lazily.

    Each process opens the file for itself, so an instance can be pickled and used after a fork or a spawn.

    Args:
        path: the HDF5 file.
        object_layout: the order of the flat ``object`` observation, ``absolute-first`` (robosuite up to 1.4.1) or
            ``relative-first`` (from 1.5); None trusts the file's ``env_version``. Both are checked against the data.

    Raises:
        DatasetError: the file is missing, truncated, or not a robomimic data set.
    """

    def __init__(self, path: str | Path, object_layout: Order | None = None) -> None:
        self._file = HDF5File(path)
        self.path = self._file.path
        try:
            self.env_args: dict[str, Any] = self._read_env_args()
            self.names: tuple[str, ...] = tuple(sorted(self._file.names("data"), key=natural_key))
            self.mask_names: tuple[str, ...] = tuple(sorted(self._file.names("mask")))
            if not self.names:
                raise self._file.error("data", "no demonstration in it", _RECORD_AGAIN)
        except BaseException:
            self.close()
            raise
        self._recording = Recording(self.env_name, self.env_version, self._action_width(), object_layout)

    def close(self) -> None:
        """Close the file; reading afterwards opens it again."""
        self._file.close()

    def __enter__(self) -> Self:
        """The file opens when it is first read."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def __repr__(self) -> str:
        """Path, task and size."""
        return f"Demonstrations({str(self.path)!r}: {self.env_name}, {len(self)} demonstrations)"

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
        """The names of the demonstrations in ``mask/<name>``, in natural order.

        Raises:
            DatasetError: there is no such mask, or it names missing demonstrations.
        """
        key = f"mask/{name}"
        if name not in self.mask_names:
            known = ", ".join(self.mask_names) or "none"
            raise self._file.error(key, "no such mask", f"the file has: {known}")
        entries = self._file.read(key).ravel().tolist()
        listed = [entry.decode(errors="replace") if isinstance(entry, bytes) else str(entry) for entry in entries]
        absent = sorted(set(listed) - set(self.names), key=natural_key)
        if absent:
            fault = f"it names {', '.join(absent[:3])}, which data does not contain"
            raise self._file.error(key, fault, "correct the mask or download the data set again")
        return sorted(listed, key=natural_key)

    @property
    def env_name(self) -> str:
        """robosuite's name of the environment, such as ``NutAssemblySquare``."""
        return str(self.env_args["env_name"])

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
        robots = self._env_kwargs().get("robots") or ()
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

    def _read_env_args(self) -> dict[str, Any]:
        if not self._file.has("data"):
            held = ", ".join(self._file.names("/")[:5]) or "nothing"
            raise self._file.error("data", f"no such group (the file holds: {held})", _NOT_ROBOMIMIC)
        attributes = self._file.attributes("data")
        if "env_args" in attributes:
            return self._parse_env_args(attributes["env_args"])
        if "repository_version" in attributes or "env_info" in attributes:
            env, version = attributes.get("env", "?"), attributes.get("repository_version", "?")
            raise self._file.error(
                "data",
                f"a raw robosuite recording ({env}, robosuite {version}), not a robomimic data set",
                f"convert a copy with robomimic's convert_robosuite.py --dataset {self.path.name}, then extract the "
                "observations with its dataset_states_to_obs.py",
            )
        raise self._file.error("data", "no attribute env_args", _NOT_ROBOMIMIC)

    def _parse_env_args(self, text: Any) -> dict[str, Any]:
        try:
            env_args = json.loads(text)
        except (TypeError, ValueError) as error:
            raise self._file.error("env_args of data", f"not JSON ({error})", _RECORD_AGAIN) from error
        if not isinstance(env_args, dict) or not isinstance(env_args.get("env_name"), str):
            raise self._file.error("env_args of data", "no object with an env_name", _RECORD_AGAIN)
        return env_args

    def _env_kwargs(self) -> dict[str, Any]:
        kwargs = self.env_args.get("env_kwargs")
        return kwargs if isinstance(kwargs, dict) else {}

    def _action_width(self) -> int | None:
        """7 for each arm under OSC_POSE; None if the controller is another one or the file does not say."""
        controllers = json.dumps(self._env_kwargs().get("controller_configs"))
        one_armed = not {*self.robots} & {"Baxter", "Tiago", "GR1", "SpotWithArm"}
        return 7 * len(self.robots) if self.robots and one_armed and '"OSC_POSE"' in controllers else None
