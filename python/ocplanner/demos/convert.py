"""Any file of demonstrations as one that other tools read: robomimic's layout of version 1.5, complete.

What a recording lacks (observations, rewards, dones) is derived from its states as :class:`Demonstrations` derives it;
nothing else is made up. The description of the environment stays the recording's own, and observations keep the order
that its version declares.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.layouts import TASK_OBJECTS, order_from_version
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.files.records.convert import CONVERT_ATTRIBUTE, ConvertRecord
from ocplanner.files.records.labels import LABEL_ATTRIBUTE
from ocplanner.files.storage import check_output
from ocplanner.settings import require
from ocplanner.versions import installed

_ARM_ACTION = 7
_FLIPPED_WITH_ACTIONS = ("actions", "actions_abs")
_GRIPPER_ONLY = "action_dict/gripper"
_PICTURES = ("_image", "_depth")
_PICTURE_DIMS = 3


@dataclass(frozen=True)
class ConvertSettings:
    """What is written besides, and what is mended."""

    next_obs: bool = False
    """Write the observations after each action too (next_obs); the last ones are repeated."""
    flip_gripper: bool = False
    """Multiply the gripper's actions by -1, for recordings in which 1 opens."""
    flip_images: bool = False
    """Turn the images upright, for recordings that store them upside down."""


DEFAULT_CONVERSION = ConvertSettings()


class Converter:
    """The arrays of demonstrations as robomimic's layout has them.

    Args:
        demos: the source.
        settings: what is written and mended.

    Attributes:
        left_out: paths of arrays that the layout has no place for, or that nothing gives (``rewards``), so far.

    Raises:
        MismatchError: what is to be mended is not there, or belongs to something that was made with it.
    """

    def __init__(self, demos: Demonstrations, settings: ConvertSettings = DEFAULT_CONVERSION) -> None:
        self._demos, self._settings = demos, settings
        self.left_out: set[str] = set()
        check_mendable(demos.path, demos.attrs, (key for demo in demos for key in demo.observation_keys), settings)

    def record(self) -> ConvertRecord:
        """What is stored with the data set."""
        return ConvertRecord(self._demos.path.name, **asdict(self._settings), versions=installed())

    def check(self, demo: Demonstration) -> None:
        """Read what can be damaged: actions, states and numbers that are observed.

        Raises:
            DatasetError: something of it is missing, damaged or not finite.
        """
        self._numbers(demo)

    def arrays(self, demo: Demonstration) -> dict[str, np.ndarray]:
        """All arrays of a demonstration of T steps by path, the first dimension of each T long.

        ``actions`` and, as far as they are stored or can be derived, ``states``, ``rewards``, ``dones``, ``obs/<key>``
        and ``next_obs/<key>``; and whatever else the source stores for each step.

        Raises:
            DatasetError: the demonstration is damaged.
        """
        stored = demo.arrays()
        arrays = {path: array for path, array in stored.items() if _fits(array, demo.length)}
        self.left_out |= stored.keys() - arrays.keys()
        arrays |= self._numbers(demo)
        mapped = self._demos.reading.names
        for key in _observed(demo):
            if key in mapped or f"obs/{key}" not in arrays:
                arrays[f"obs/{key}"] = demo.observation(key)
        for key in mapped.keys() & {*demo.next_observation_keys}:
            arrays[f"next_obs/{key}"] = demo.next_observation(key)
        if "object" in demo.observation_keys and "obs/object" not in stored:
            arrays["obs/object"] = self._in_declared_order(demo, arrays["obs/object"])
        arrays |= self._ending(demo, stored)
        return mended(arrays, self._settings)

    def _numbers(self, demo: Demonstration) -> dict[str, np.ndarray]:
        arrays = {"actions": demo.actions}
        if self._demos.kind != "other" and "states" in demo.array_paths:
            arrays["states"] = demo.states
        for key in _observed(demo):
            if demo.observation(key, slice(0, 1)).ndim < 3:
                arrays[f"obs/{key}"] = array = demo.observation(key)
                if array.dtype.kind == "f" and not np.isfinite(array).all():
                    raise DatasetError(f"{demo!r}: obs/{key} is not finite everywhere; record the demonstration again")
        return arrays

    def _in_declared_order(self, demo: Demonstration, objects: np.ndarray) -> np.ndarray:
        """``object`` as the recording's version writes it, so that readers who trust ``env_version`` are right."""
        wanted, task = order_from_version(self._demos.env_version), TASK_OBJECTS.get(self._demos.env_name)
        if task is None or not task.relative or wanted in (None, demo.object_layout()):
            return objects
        blocks = objects.reshape(len(objects), -1, 2, 7)
        return blocks[:, :, ::-1].reshape(objects.shape)

    def _ending(self, demo: Demonstration, stored: Iterable[str]) -> dict[str, np.ndarray]:
        """Rewards and dones. Rewards that nobody recorded or can derive are left out rather than made up."""
        dones = demo.dones if "dones" in stored else (np.arange(demo.length) == demo.length - 1).astype(np.int64)
        try:
            return {"rewards": demo.rewards, "dones": dones}
        except DatasetError:
            if "rewards" in stored:
                raise
            self.left_out.add("rewards")
            return {"dones": dones}


def convert_dataset(
    source: str | Path,
    target: str | Path,
    conversion: ConvertSettings = DEFAULT_CONVERSION,
    *,
    reading: ReadSettings = DEFAULT_READING,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Write a data set in robomimic's layout of version 1.5.

    If the function is stopped, the next call with the same settings continues and ends with the same file.

    Args:
        source: any file that :class:`Demonstrations` reads.
        target: the file to make.
        conversion: what is written besides, and what is mended.
        reading: how the source is read.
        limit: convert only the first so many demonstrations.
        overwrite: replace ``target`` if it exists.
        progress: called with the name and the number of steps of each demonstration, first for those that an earlier
            call finished.
        say: called with a line about each demonstration and each array that is left out.

    Raises:
        InvalidValueError: ``limit`` is not positive.
        DatasetError: the source, or some of its demonstrations, cannot be read.
        MismatchError: what is to be mended is not there.
        OutputError: the target exists, is the source, cannot be written, or was begun with other settings or from
            another source.
    """
    require(limit is None or limit >= 1, f"limit is {limit}, but must be at least 1")
    reads = [source, reading.keys]
    check_output(Path(target), overwrite, "HDF5 data set", reads, resumed=True)
    with Demonstrations(source, reading=reading) as demos:
        converter = Converter(demos, conversion)
        masks = {mask: demos.mask(mask) for mask in demos.mask_names}
        names = sound_names(demos, demos.names[:limit], converter.check, say)
        masks = {mask: [name for name in listed if name in names] for mask, listed in masks.items()}
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        attrs[CONVERT_ATTRIBUTE] = converter.record().to_json()
        with DatasetWriter(target, demos.env_args, data_attrs=attrs, overwrite=overwrite, reads=reads) as writer:
            done = {name for name in writer.done if name in names and writer.holds(name, demos[name].digest())}
            for name in sorted(names, key=lambda name: name not in done):
                demo = demos[name]
                if name not in done:
                    writer.add(name, converter.arrays(demo), written_attributes(demo), demo.digest())
                if progress:
                    progress(name, demo.length)
            path = writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)
    if say is not None:
        for left_out in sorted(converter.left_out):
            say(f"left out {left_out}: {_WHY.get(left_out, 'not one number or picture for each step')}")
    return path


_WHY = {"rewards": "none were recorded, and no simulated task gives them"}


def check_mendable(path: Path, attrs: Mapping[str, Any], observed: Iterable[str], settings: ConvertSettings) -> None:
    """Check that what is to be turned round is there, and that nothing was made with it as it is.

    Args:
        path: of the source, for errors.
        attrs: the attributes of its ``data``.
        observed: names or paths of its observations.
        settings: what is to be turned round.

    Raises:
        MismatchError: it is not.
    """
    if settings.flip_gripper and LABEL_ATTRIBUTE in attrs:
        raise MismatchError(
            f"{path}: its labels say where the gripper holds the object, so it cannot be turned round now; convert the "
            "data set that was labelled, and label that"
        )
    if settings.flip_images and not any(name.endswith(_PICTURES) for name in observed):
        raise MismatchError(f"{path} holds no images to turn; leave out --flip-images")


def mended(arrays: dict[str, np.ndarray], settings: ConvertSettings) -> dict[str, np.ndarray]:
    """The arrays of a demonstration by path with what the settings turn round and add."""
    arrays = dict(arrays)
    if settings.flip_gripper:
        for path in arrays.keys() & {*_FLIPPED_WITH_ACTIONS, _GRIPPER_ONLY}:
            arrays[path] = _gripper_flipped(arrays[path], whole=path == _GRIPPER_ONLY)
    if settings.flip_images:
        for path in [path for path in arrays if "obs/" in path and path.endswith(_PICTURES)]:
            if arrays[path].ndim < _PICTURE_DIMS or (arrays[path].dtype == np.uint8 and arrays[path].shape[-1] > 4):
                raise MismatchError(
                    f"{path} has shape {arrays[path].shape}, not (steps, height, width, channels), and cannot be "
                    "turned; store the pictures so, or leave out --flip-images"
                )
            arrays[path] = arrays[path][:, ::-1]
    if settings.next_obs:
        for path in [path for path in arrays if path.startswith("obs/")]:
            arrays.setdefault(f"next_{path}", np.concatenate([arrays[path][1:], arrays[path][-1:]]))
    return arrays


def written_attributes(demo: Demonstration) -> dict[str, object]:
    """A demonstration's attributes without a ``model_file`` that is no model.

    robosuite 1.0 stored the name of a file there, which readers of this layout would take for XML.
    """
    return {
        key: value for key, value in demo.attrs.items() if key != "model_file" or str(value).lstrip().startswith("<")
    }


def _observed(demo: Demonstration) -> list[str]:
    """The observations that are arrays, not groups of arrays, as some robots record them."""
    groups = {path.split("/")[1] for path in demo.array_paths if path.startswith("obs/") and path.count("/") > 1}
    return [key for key in demo.observation_keys if key not in groups]


def _fits(array: np.ndarray, steps: int) -> bool:
    return array.ndim > 0 and len(array) == steps and array.dtype.kind in "fiub"


def _gripper_flipped(actions: np.ndarray, *, whole: bool) -> np.ndarray:
    if whole:
        return -actions
    flipped = actions.copy()
    width = actions.shape[1]
    arm = _ARM_ACTION if width % _ARM_ACTION == 0 else width
    flipped[:, arm - 1 :: arm] *= -1
    return flipped
