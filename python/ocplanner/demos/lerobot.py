"""LeRobot data sets (format v3: parquet and mp4) from files of demonstrations, and back.

Which array goes where, :mod:`ocplanner.demos.lerobot_layout` says. What LeRobot has no place for (``env_args``, names,
masks, models) is kept in ``meta/ocplanner.json.gz``, which others ignore.
"""

import contextlib
import gzip
import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from ocplanner.demos.convert import (
    DEFAULT_CONVERSION,
    Converter,
    ConvertSettings,
    check_mendable,
    mended,
    written_attributes,
)
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.lerobot_layout import NEXT, REWARD, LeRobotLayout, Pictures, paths_of, unpack
from ocplanner.demos.lerobot_process import LeRobotProcess
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, OutputError
from ocplanner.files.records.convert import CONVERT_ATTRIBUTE, ConvertRecord
from ocplanner.files.storage import check_folder, check_output, locked, writing
from ocplanner.settings import require, require_choice
from ocplanner.versions import installed

INFO = Path("meta") / "info.json"
"""What every LeRobot data set has."""

_OURS = Path("meta") / "ocplanner.json.gz"
_KEPT = {"env_args", "attrs", "names", "steps", "attributes", "masks", "paths", "flat"}
_WRITE_AGAIN = "check the disk and run the same command again"
_WHOLE = "check that the data set is whole and of format v3 (lerobot itself converts older ones)"


@dataclass(frozen=True)
class LeRobotSettings:
    """How a LeRobot data set is written.

    Raises:
        InvalidValueError: the frequency is not positive.
        UnknownNameError: no such kind of pictures.
    """

    repo_id: str | None = None
    """Its name on the Hub, USER/NAME; nothing is uploaded. Default: local/ and the target's name."""
    instruction: str | None = None
    """What the robot is to do, in words. Default: each demonstration's own, else the task's name."""
    fps: int | None = None
    """Steps per second, where the source does not say."""
    images: Pictures = "video"
    """Videos are small and lossy; png keeps every pixel."""

    def __post_init__(self) -> None:
        """Check names and numbers."""
        require_choice("kind of images", self.images, Pictures)
        require(self.fps is None or self.fps >= 1, f"fps is {self.fps}, but must be at least 1")


DEFAULT_LEROBOT = LeRobotSettings()


def is_lerobot(path: str | Path) -> bool:
    """Whether a path is the folder of a LeRobot data set."""
    return (Path(path) / INFO).is_file()


def episodes(path: str | Path) -> int:
    """How many episodes a LeRobot data set has.

    Raises:
        DatasetError: it is none, or its description cannot be read.
    """
    if not is_lerobot(path):
        raise DatasetError(f"{path}: no LeRobot data set (no {INFO}); give the folder of one")
    try:
        return int(json.loads((Path(path) / INFO).read_text(encoding="utf-8"))["total_episodes"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{Path(path) / INFO} cannot be read ({error!r}); download the data set again") from error


def to_lerobot(
    source: str | Path,
    target: str | Path,
    settings: LeRobotSettings = DEFAULT_LEROBOT,
    conversion: ConvertSettings = DEFAULT_CONVERSION,
    *,
    reading: ReadSettings = DEFAULT_READING,
    python: Path | None = None,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Write a LeRobot data set. It appears whole or not at all; a stopped conversion begins anew.

    Args:
        source: any file that :class:`Demonstrations` reads.
        target: the folder to make.
        settings: how it is written.
        conversion: what is mended on the way.
        reading: how the source is read.
        python: the Python of an environment with lerobot; this one if None.
        limit: convert only the first so many demonstrations.
        overwrite: replace ``target`` if it is a LeRobot data set.
        progress: called with the name and the number of steps of each demonstration.
        say: called with a line for everything that is left out.

    Raises:
        DatasetError: the source, or some of its demonstrations, cannot be read.
        InvalidValueError: the frequency is missing or no whole number, or ``limit`` is not positive.
        MismatchError: the settings contradict the source.
        OutputError: the target exists or cannot be written.
        VersionError: there is no lerobot.
    """
    target = Path(target)
    require(limit is None or limit >= 1, f"limit is {limit}, but must be at least 1")
    require(not conversion.next_obs, "LeRobot data sets have no next_obs: leave out --next-obs")
    _check_target(target, [source, reading.keys], overwrite)
    with Demonstrations(source, reading=reading) as demos, locked(target):
        converter = Converter(demos, conversion)
        masks = {mask: demos.mask(mask) for mask in demos.mask_names}
        names = sound_names(demos, demos.names[:limit], converter.check, say)
        masks = {mask: [name for name in listed if name in names] for mask, listed in masks.items()}
        fps = _frequency(demos, names[0], settings.fps)
        partial = target.with_name(f".{target.name}.partial")
        with writing(target):
            if partial.exists():
                shutil.rmtree(partial)
            partial.mkdir()
        layout: LeRobotLayout | None = None
        try:
            with LeRobotProcess(python, OutputError, target, _WRITE_AGAIN) as lerobot:
                for name in names:
                    demo = demos[name]
                    arrays = converter.arrays(demo)
                    if layout is None:
                        layout = LeRobotLayout.of(demo, arrays, settings.images)
                        lost = {path for path in arrays.keys() - layout.paths.keys() if not path.startswith(NEXT)}
                        converter.left_out |= lost
                        lerobot.ask(
                            "create",
                            root=str(partial / "data"),
                            repo_id=settings.repo_id or f"local/{target.name}",
                            fps=fps,
                            features=layout.features,
                            robot_type=demos.robots[0] if demos.robots else None,
                        )
                    with writing(target):
                        np.savez(partial / "episode.npz", **layout.pack(demo, arrays))
                    task = settings.instruction or demo.attrs.get("task") or demos.task_name
                    lerobot.ask("add", arrays=str(partial / "episode.npz"), task=str(task))
                    if progress:
                        progress(name, demo.length)
                lerobot.ask("finish")
            with writing(target):
                _write_ours(partial / "data" / _OURS, demos, names, masks, cast(LeRobotLayout, layout))
                if target.exists():
                    target.rename(partial / "replaced")
                (partial / "data").rename(target)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    if say is not None:
        for path in sorted(converter.left_out):
            say(f"left out {path}")
    return target


def from_lerobot(
    source: str | Path,
    target: str | Path,
    conversion: ConvertSettings = DEFAULT_CONVERSION,
    *,
    python: Path | None = None,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Callable[[str, int], None] | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Write a LeRobot data set in robomimic's layout of version 1.5.

    What :func:`to_lerobot` wrote comes back under its own names. Of any other data set, ``observation.X`` becomes
    ``obs/X`` (``state``, ``environment_state``), cameras become ``obs/<camera>_image``, and there are no ``env_args``:
    policies can be trained on such a file. A stopped conversion continues when it is called again.

    Args:
        source: the folder of the data set.
        target: the file to make.
        conversion: what is written besides and mended.
        python: the Python of an environment with lerobot; this one if None.
        limit: convert only the first so many episodes.
        overwrite: replace ``target`` if it exists.
        progress: called with the name and the number of steps of each episode, first for those of an earlier run.
        say: called with a line for everything that is left out.

    Raises:
        DatasetError: the source cannot be read.
        InvalidValueError: ``limit`` is not positive.
        MismatchError: what is to be mended is not there.
        OutputError: the target exists, cannot be written, or was begun from something else.
        VersionError: there is no lerobot.
    """
    source, target = Path(source), Path(target)
    require(limit is None or limit >= 1, f"limit is {limit}, but must be at least 1")
    episodes(source)
    check_output(target, overwrite, "HDF5 data set", [source], resumed=True)
    with LeRobotProcess(python, DatasetError, source, _WHOLE) as lerobot, contextlib.ExitStack() as opened:
        found = lerobot.ask("open", root=str(source))
        ours = _read_ours(source, found["steps"])
        names = ours["names"][:limit]
        try:
            paths = paths_of(found["features"], ours.get("paths", {}))
        except DatasetError as error:
            raise DatasetError(f"{source}: {error}") from error
        attrs = ours.get("attrs", {"fps": found["fps"], "robot_type": found["robot_type"] or "unknown"})
        check_mendable(source, attrs, paths.values(), conversion)
        attrs[CONVERT_ATTRIBUTE] = ConvertRecord(source.name, **asdict(conversion), versions=installed()).to_json()
        writer = opened.enter_context(DatasetWriter(target, ours["env_args"], data_attrs=attrs, overwrite=overwrite))
        identity = _identity(source)
        exchange = Path(opened.enter_context(tempfile.TemporaryDirectory())) / "episode.npz"
        digests = {name: f"{identity} {number}" for number, name in enumerate(ours["names"])}
        done = {name for name in writer.done if name in names and writer.holds(name, digests[name])}
        for name in sorted(names, key=lambda name: name not in done):
            number = ours["names"].index(name)
            if name not in done:
                tasks = lerobot.ask("read", episode=number, arrays=str(exchange))["tasks"]
                with np.load(exchange) as file:
                    arrays = unpack(file, found["features"], paths, ours["flat"])
                attributes = ours["attributes"][number] if "attributes" in ours else {"task": "; ".join(tasks)}
                writer.add(name, mended(arrays, conversion), attributes, digests[name])
            if progress:
                progress(name, found["steps"][number])
        masks = {mask: [name for name in listed if name in names] for mask, listed in ours["masks"].items()}
        path = writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)
    if say is not None:
        for key in sorted(found["features"].keys() - paths.keys()):
            say(f"left out {key}")
        if REWARD not in paths:
            say("left out rewards: none were recorded")
    return path


def _frequency(demos: Demonstrations, name: str, given: int | None) -> int:
    """Steps per second: the recording's word, else the times of a demonstration's states, else what is given."""
    kwargs = demos.env_args.get("env_kwargs")
    recorded = kwargs.get("control_freq") if isinstance(kwargs, dict) else demos.attrs.get("fps")
    if recorded is None and demos.kind != "other" and "states" in demos[name].array_paths:
        step = float(np.median(np.diff(demos[name].states[:, 0])))
        recorded = round(1 / step, 3) if step > 0 else None
    if recorded is None:
        require(given is not None, f"{demos.path} does not say how many steps a second has; give it: --fps")
        return int(given or 0)
    if not isinstance(recorded, int | float | np.number) or recorded != int(recorded) or recorded < 1:
        raise InvalidValueError(f"{demos.path} was recorded at {recorded} Hz, but LeRobot's format has whole numbers")
    if given is not None and given != recorded:
        raise MismatchError(f"{demos.path} was recorded at {recorded:g} Hz, not {given}; leave out --fps")
    return int(recorded)


def _check_target(target: Path, reads: Sequence[str | Path | None], overwrite: bool) -> None:
    check_folder(target, [], str(INFO), reads)
    if not target.exists():
        return
    if not overwrite:
        raise OutputError(
            f"{target} exists already; choose another output, or allow overwriting (--overwrite; overwrite=True)"
        )
    if not is_lerobot(target):
        raise OutputError(f"{target} exists already and is no LeRobot data set; choose another output, or remove it")


def _write_ours(
    path: Path,
    demos: Demonstrations,
    names: Sequence[str],
    masks: Mapping[str, Sequence[str]],
    layout: LeRobotLayout,
) -> None:
    kept = {
        "env_args": demos.env_args,
        "attrs": {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}},
        "names": names,
        "steps": [demos[name].length for name in names],
        "attributes": [written_attributes(demos[name]) for name in names],
        "masks": masks,
        "paths": {feature: path for path, feature in layout.paths.items()},
        "flat": layout.flat,
    }
    path.write_bytes(gzip.compress(json.dumps(kept, default=_plain).encode()))


def _plain(value: Any) -> Any:
    """A NumPy number or array in JSON."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _read_ours(source: Path, steps: Sequence[int]) -> dict[str, Any]:
    """What :func:`to_lerobot` kept beside the data set, or what stands for it in another's."""
    if not (source / _OURS).exists():
        names = [f"demo_{i}" for i in range(len(steps))]
        return {"env_args": {}, "names": names, "masks": {}, "flat": ["rewards", "dones"]}
    remedy = f"remove {_OURS} to convert it without the names and the environment that it keeps"
    try:
        kept = json.loads(gzip.decompress((source / _OURS).read_bytes()))
        missing = _KEPT - kept.keys()
        if missing:
            raise ValueError(f"no {', '.join(sorted(missing))}")
        same = list(kept["steps"]) == list(steps)
    except (OSError, EOFError, ValueError, AttributeError, TypeError) as error:
        raise DatasetError(f"{source / _OURS} is damaged ({error}); {remedy}") from error
    if not same:
        raise DatasetError(f"{source}: its episodes were changed since it was written from HDF5; {remedy}")
    return kept


def _identity(source: Path) -> str:
    """Hash of the description and the statistics: what tells a data set from one of the same name."""
    digest = hashlib.sha256()
    for name in ("info.json", "stats.json"):
        path = source / "meta" / name
        digest.update(path.read_bytes() if path.exists() else b"")
    return digest.hexdigest()
