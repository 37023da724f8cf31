"""Reading robomimic HDF5 files: v0.1, v1.4.1 and v1.5, with or without images, models, masks and next observations."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Self, overload

from ocplanner.demos.demonstration import Demonstration, Recording
from ocplanner.demos.layouts import Order
from ocplanner.demos.recorded_task import recorded_task
from ocplanner.files.hdf5 import HDF5File
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, LabelRecord
from ocplanner.files.records.render import RENDER_ATTRIBUTE, RenderRecord
from ocplanner.files.storage import natural_key


class Demonstrations(Sequence[Demonstration]):
    """The demonstrations of one robomimic file, read lazily.

    Every process opens the file for itself: an instance can be pickled, and used after a fork or a spawn.

    Args:
        path: the HDF5 file.
        object_layout: the order of the flat ``object`` observation, ``absolute-first`` (robosuite up to 1.4.1) or
            ``relative-first`` (from 1.5); None believes the file's ``env_version``. Either is checked against the data.

    Raises:
        DatasetError: the file is missing, truncated, or no robomimic data set.
    """

    def __init__(self, path: str | Path, object_layout: Order | None = None) -> None:
        self._file = HDF5File(path)
        self.path = self._file.path
        try:
            self.env_args: dict[str, Any] = self._read_env_args()
            self.names: tuple[str, ...] = tuple(sorted(self._file.names("data"), key=natural_key))
            self.mask_names: tuple[str, ...] = tuple(sorted(self._file.names("mask")))
            if not self.names:
                raise self._file.error("data", "no demonstration in it", "record or download the data set again")
        except BaseException:
            self.close()
            raise
        self._recording = Recording(self.env_name, self.env_version, self._action_width(), object_layout)

    def close(self) -> None:
        """Close the file; reading afterwards opens it again."""
        self._file.close()

    def __enter__(self) -> Self:
        """Nothing to do: the file opens itself."""
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
        """One demonstration, by name or by its place in the natural order; a slice gives a list."""
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
            DatasetError: no such mask, or it names demonstrations that are not there.
        """
        key = f"mask/{name}"
        if name not in self.mask_names:
            known = ", ".join(self.mask_names) or "none"
            raise self._file.error(key, "no such mask", f"the masks there are: {known}")
        entries = self._file.read(key).ravel().tolist()
        listed = [entry.decode(errors="replace") if isinstance(entry, bytes) else str(entry) for entry in entries]
        absent = sorted(set(listed) - set(self.names), key=natural_key)
        if absent:
            fault = f"it names {', '.join(absent[:3])}, which data does not hold"
            raise self._file.error(key, fault, "correct the mask or download the data set again")
        return sorted(listed, key=natural_key)

    @property
    def env_name(self) -> str:
        """robosuite's name of the environment, such as ``NutAssemblySquare``."""
        return str(self.env_args["env_name"])

    @property
    def env_version(self) -> str | None:
        """robosuite's version at recording; None when the file does not say."""
        version = self.env_args.get("env_version")
        return None if version is None else str(version)

    @property
    def task_name(self) -> str:
        """The task's short name (``Square``), or the environment's where ocplanner has no other."""
        task = recorded_task(self.env_name)
        return self.env_name if task is None else task.name

    @property
    def robots(self) -> tuple[str, ...]:
        """The recorded robots, such as ``("Panda",)``; empty when the file does not say."""
        robots = self._env_kwargs().get("robots") or ()
        return (robots,) if isinstance(robots, str) else tuple(str(robot) for robot in robots)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras whose images the first demonstration holds, as ``obs/<camera>_image``."""
        return self[0].cameras

    @property
    def attrs(self) -> dict[str, Any]:
        """The attributes of ``data`` as stored (``env_args``, ``total``, ...)."""
        return self._file.attributes("data")

    @property
    def render_record(self) -> RenderRecord | None:
        """How ``ocplanner render`` drew the images; None if something else did, or there are none."""
        text = self.attrs.get(RENDER_ATTRIBUTE)
        if text is None:
            return None
        try:
            return RenderRecord.from_json(text)
        except (TypeError, ValueError) as error:
            fault = f"cannot be read ({error})"
            raise self._file.error(f"{RENDER_ATTRIBUTE} of data", fault, "render the data set again") from error

    @property
    def observe(self) -> str:
        """What the images show of the robot: ``"full"`` unless ``ocplanner render`` drew something else."""
        record = self.render_record
        return "full" if record is None else record.observe

    @property
    def label_record(self) -> LabelRecord | None:
        """How ``ocplanner label`` made the hints and rewards; None if there are none, or something else made them."""
        text = self.attrs.get(LABEL_ATTRIBUTE)
        if text is None:
            return None
        try:
            return LabelRecord.from_json(text)
        except (TypeError, ValueError) as error:
            fault = f"cannot be read ({error})"
            raise self._file.error(f"{LABEL_ATTRIBUTE} of data", fault, "label the data set again") from error

    def _read_env_args(self) -> dict[str, Any]:
        if not self._file.has("data"):
            held = ", ".join(self._file.names("/")[:5]) or "nothing"
            raise self._file.error("data", f"not there (the file holds: {held})", "this is no robomimic data set")
        attributes = self._file.attributes("data")
        if "env_args" in attributes:
            env_args = self._json("env_args", attributes["env_args"])
            if not isinstance(env_args.get("env_name"), str):
                raise self._file.error("env_args of data", "no env_name in it", "record the data set again")
            return env_args
        if "repository_version" in attributes or "env_info" in attributes:
            env, version = attributes.get("env", "?"), attributes.get("repository_version", "?")
            raise self._file.error(
                "data",
                f"a raw robosuite recording ({env}, robosuite {version}), not a robomimic data set",
                f"convert a copy with robomimic's convert_robosuite.py --dataset {self.path.name}, then extract the "
                "observations with its dataset_states_to_obs.py",
            )
        raise self._file.error("data", "no attribute env_args", "this is no robomimic data set")

    def _json(self, attribute: str, text: Any) -> dict[str, Any]:
        try:
            value = json.loads(text)
        except (TypeError, ValueError) as error:
            raise self._file.error(f"{attribute} of data", f"no JSON ({error})", "make the file again") from error
        if not isinstance(value, dict):
            raise self._file.error(f"{attribute} of data", f"{type(value).__name__}, no object", "make the file again")
        return value

    def _env_kwargs(self) -> dict[str, Any]:
        kwargs = self.env_args.get("env_kwargs")
        return kwargs if isinstance(kwargs, dict) else {}

    def _action_width(self) -> int | None:
        """7 an arm under OSC_POSE; None when the controller is another or the file does not say."""
        controllers = json.dumps(self._env_kwargs().get("controller_configs"))
        one_armed = not {*self.robots} & {"Baxter", "Tiago", "GR1", "SpotWithArm"}
        return 7 * len(self.robots) if self.robots and one_armed and '"OSC_POSE"' in controllers else None
