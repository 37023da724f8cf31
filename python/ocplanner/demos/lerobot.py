"""LeRobot data sets (format v3: parquet and mp4) from files of demonstrations, and back.

lerobot cannot be installed beside robosuite 1.5.2: the one needs NumPy 2, the other, through mink, an older NumPy. A
program that the Python of lerobot's own environment runs therefore reads and writes for us
(:mod:`ocplanner.integrations.lerobot`). That works with the lerobot that a user trains with, whichever it is.

What goes where (HDF5 path, LeRobot feature):

- ``actions``: ``action``, float32.
- ``obs/<key>``, low-dimensional: ``observation.state``, float32; its ``names`` are ``<key>.0``, ``<key>.1``, ... What
  says where objects are goes to ``observation.environment_state``, so that a policy sees it only if it is meant to.
- ``obs/<camera>_image``: ``observation.images.<camera>``, video or, lossless, png.
- ``rewards``, ``dones``: ``next.reward``, float32; ``next.done``.
- Anything else of at most three dimensions that is no picture, such as ``states``: ``hdf5.<path>`` in its own type.
  Policies of LeRobot read features named ``observation`` and ``action``, so they do not see these.

What LeRobot has no place for (``env_args``, names, masks, models) is kept in ``meta/ocplanner.json.gz``.
"""

import contextlib
import gzip
import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any, Literal, Self, cast

import numpy as np

import ocplanner
from ocplanner.demos.convert import (
    DEFAULT_CONVERSION,
    Converter,
    ConvertSettings,
    mended,
    written_attributes,
)
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, OcplannerError, OutputError, VersionError
from ocplanner.files.records.convert import CONVERT_ATTRIBUTE, ConvertRecord
from ocplanner.files.storage import check_folder, check_output, locked, writing
from ocplanner.settings import require, require_choice
from ocplanner.versions import installed

Pictures = Literal["video", "png"]

INFO = Path("meta") / "info.json"
"""What every LeRobot data set has."""

_OURS = Path("meta") / "ocplanner.json.gz"
_KEPT = {"env_args", "attrs", "names", "steps", "attributes", "masks", "paths", "flat"}
_STATE, _ENVIRONMENT, _IMAGES = "observation.state", "observation.environment_state", "observation.images."
_REWARD, _DONE = "next.reward", "next.done"
_EXTRA, _NEXT = "hdf5.", "next_obs/"
_FRAME_NAMES = ["height", "width", "channels"]
_MOST_DIMS = 3
_PICTURES = ("_image", "_depth", "_empty", "_mask", "_silhouettes")
_INSTALL = (
    "make an environment for it, since it cannot be installed beside robosuite (python3.12 -m venv lerobot; "
    "lerobot/bin/pip install 'lerobot[dataset]'), and name its Python: --lerobot-python lerobot/bin/python"
)

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


class LeRobotProcess:
    """lerobot, run by a Python that has it; a context manager.

    Args:
        python: that Python; this one if None.
        failure: what an error of lerobot's is raised as.
        what: what is read or written, for the error.
        remedy: of the error.

    Raises:
        VersionError: there is no lerobot.
    """

    def __init__(self, python: Path | None, failure: type[OcplannerError], what: Path, remedy: str) -> None:
        if python is None and importlib.util.find_spec("lerobot") is None:
            raise VersionError(f"LeRobot data sets need lerobot 0.4 or later; {_INSTALL}")
        self._python, self._failure, self._what, self._remedy = Path(python or sys.executable), failure, what, remedy
        script = Path(ocplanner.__file__).parent / "integrations" / "lerobot.py"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        environment["HF_HUB_OFFLINE"] = "1"  # a damaged data set would be looked for on the Hub
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process has ended
        try:
            self._process = subprocess.Popen(
                [self._python, script],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                env=environment,
                text=True,
            )
        except OSError as error:
            self._log.close()
            raise VersionError(f"cannot run {python} ({error.strerror}); {_INSTALL}") from error
        self._requests, self._answers = cast(IO[str], self._process.stdin), cast(IO[str], self._process.stdout)

    def ask(self, do: str, **arguments: Any) -> dict[str, Any]:
        """Have something done.

        Raises:
            VersionError: there is no lerobot.
            OcplannerError: lerobot failed.
        """
        with contextlib.suppress(BrokenPipeError):
            self._requests.write(json.dumps({"do": do, **arguments}) + "\n")
            self._requests.flush()
        line = self._answers.readline()
        if not line:
            raise self._failure(f"{self._what}: lerobot ended unexpectedly ({self._last_words()}); {self._remedy}")
        answer = json.loads(line)
        if "error" not in answer:
            return answer
        if answer["error"].startswith(("ImportError", "ModuleNotFoundError")):
            raise VersionError(f"{self._python} has no lerobot that works ({answer['error']}); {_INSTALL}")
        raise self._failure(f"{self._what}: lerobot failed ({answer['error']}); {self._remedy}")

    def __enter__(self) -> Self:
        """The process runs since it was made."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            self._requests.close()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._answers.close()
        self._log.close()

    def _last_words(self) -> str:
        self._process.wait()
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"status {self._process.returncode}"


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
        converter, fps = Converter(demos, conversion), _frequency(demos, settings.fps)
        masks = {mask: demos.mask(mask) for mask in demos.mask_names}
        names = sound_names(demos, demos.names[:limit], converter.check, say)
        masks = {mask: [name for name in listed if name in names] for mask, listed in masks.items()}
        partial = target.with_name(f".{target.name}.partial")
        with writing(target):
            if partial.exists():
                shutil.rmtree(partial)
            partial.mkdir()
        layout: _Layout | None = None
        try:
            with LeRobotProcess(python, OutputError, target, _WRITE_AGAIN) as lerobot:
                for name in names:
                    demo = demos[name]
                    arrays = converter.arrays(demo)
                    if layout is None:
                        layout = _Layout.of(demo, arrays, settings.images)
                        lost = {path for path in arrays.keys() - layout.paths.keys() if not path.startswith(_NEXT)}
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
                _write_ours(partial / "data" / _OURS, demos, names, masks, cast(_Layout, layout))
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
        paths = _paths(found["features"], ours.get("paths", {}))
        if conversion.flip_images and not any(path.endswith("_image") for path in paths.values()):
            raise MismatchError(f"{source} holds no images to turn; leave out --flip-images")
        attrs = ours.get("attrs", {"fps": found["fps"], "robot_type": found["robot_type"] or "unknown"})
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
                    arrays = _unpack(file, found["features"], paths, ours["flat"])
                attributes = ours["attributes"][number] if "attributes" in ours else {"task": "; ".join(tasks)}
                writer.add(name, mended(arrays, conversion), attributes, digests[name])
            if progress:
                progress(name, found["steps"][number])
        masks = {mask: [name for name in listed if name in names] for mask, listed in ours["masks"].items()}
        path = writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)
    if say is not None:
        for key in sorted(found["features"].keys() - paths.keys()):
            say(f"left out {key}")
        if _REWARD not in paths:
            say("left out rewards: none were recorded")
    return path


@dataclass(frozen=True)
class _Layout:
    """Where the arrays of a source go.

    Attributes:
        features: LeRobot's description of them.
        paths: path of each array that has a place -> its feature.
        vectors: feature of a vector -> the arrays that it is put together from, each with its width.
        flat: paths of arrays of one dimension.
    """

    features: Mapping[str, dict[str, Any]]
    paths: Mapping[str, str]
    vectors: Mapping[str, Sequence[tuple[str, int]]]
    flat: Sequence[str]

    @classmethod
    def of(cls, demo: Demonstration, arrays: Mapping[str, np.ndarray], images: Pictures) -> "_Layout":
        features: dict[str, dict[str, Any]] = {}
        paths: dict[str, str] = {}
        vectors: dict[str, list[tuple[str, int]]] = {}
        for path in sorted(arrays):
            array, key = arrays[path], path.removeprefix("obs/")
            if path.startswith(_NEXT):  # --next-obs makes them again on the way back
                continue
            if path == "actions":
                paths[path] = "action"
                features["action"] = _feature(array, "float32", _action_names(array.shape[1]))
            elif path == "rewards":
                paths[path] = _REWARD
                features[_REWARD] = _feature(array, "float32")
            elif path == "dones":
                paths[path] = _DONE
                features[_DONE] = _feature(array, "bool")
            elif key != path and key.endswith("_image") and array.ndim == _MOST_DIMS + 1:
                paths[path] = feature = _IMAGES + key.removesuffix("_image")
                if images == "video" and (array.shape[1] % 2 or array.shape[2] % 2):
                    size = f"{array.shape[2]} x {array.shape[1]}"
                    raise MismatchError(f"{demo!r}: videos have even sides, but {path} is {size}; use --images png")
                features[feature] = {
                    "dtype": "image" if images == "png" else "video",
                    "shape": array.shape[1:],
                    "names": _FRAME_NAMES,
                }
            elif key != path and array.ndim < _MOST_DIMS and not key.startswith("ocp_"):
                environment = key == "object" or key.startswith(tuple(f"{name}_" for name in demo.object_names))
                paths[path] = feature = _ENVIRONMENT if environment else _STATE
                vectors.setdefault(feature, []).append((path, 1 if array.ndim == 1 else array.shape[1]))
            elif array.ndim <= _MOST_DIMS and not key.endswith(_PICTURES):
                paths[path] = feature = _EXTRA + path.replace("/", ".")
                features[feature] = _feature(array, str(array.dtype))
        for feature, parts in vectors.items():
            names = [f"{path.removeprefix('obs/')}.{i}" for path, width in parts for i in range(width)]
            features[feature] = {"dtype": "float32", "shape": (len(names),), "names": names}
        return cls(features, paths, vectors, [path for path in paths if arrays[path].ndim == 1])

    def pack(self, demo: Demonstration, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The arrays of one demonstration by feature.

        Raises:
            DatasetError: they are not those of the first demonstration.
        """
        packed: dict[str, np.ndarray] = {}
        for path, feature in self.paths.items():
            if path not in arrays:
                raise DatasetError(f"{demo!r}: no {path}, which others have; leave the demonstration out")
            if feature not in self.vectors:
                packed[feature] = _with_width(arrays[path]).astype(_stored_as(self.features[feature]), copy=False)
        for feature, parts in self.vectors.items():
            packed[feature] = np.concatenate([_with_width(arrays[path]) for path, _ in parts], 1).astype(np.float32)
        for feature, array in packed.items():
            wanted = tuple(self.features[feature]["shape"])
            if array.shape[1:] != wanted:
                raise DatasetError(f"{demo!r}: {feature} has shape {array.shape[1:]}, others {wanted}; leave it out")
        return packed


def _feature(array: np.ndarray, dtype: str, names: Sequence[str] | None = None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": _with_width(array).shape[1:], "names": names}


def _stored_as(feature: Mapping[str, Any]) -> str:
    return "uint8" if feature["dtype"] in ("image", "video") else feature["dtype"]


def _with_width(array: np.ndarray) -> np.ndarray:
    """(T, 1) for (T,): LeRobot's features have a shape."""
    return array[:, None] if array.ndim == 1 else array


def _action_names(width: int) -> list[str]:
    each = ("x", "y", "z", "rotation_x", "rotation_y", "rotation_z", "gripper")
    if width % len(each):
        return [f"action.{i}" for i in range(width)]
    return [f"robot{arm}.{name}" for arm in range(width // len(each)) for name in each]


def _frequency(demos: Demonstrations, given: int | None) -> int:
    """Steps per second: the recording's word, else the times of its states, else what is given."""
    kwargs = demos.env_args.get("env_kwargs")
    recorded = kwargs.get("control_freq") if isinstance(kwargs, dict) else demos.attrs.get("fps")
    if recorded is None and demos.kind != "other" and "states" in demos[0].array_paths:
        recorded = round(1 / float(np.median(np.diff(demos[0].states[:, 0]))), 3)
    if recorded is None:
        require(given is not None, f"{demos.path} does not say how many steps a second has; give it: --fps")
        return int(given or 0)
    if given is not None and given != recorded:
        raise MismatchError(f"{demos.path} was recorded at {recorded:g} Hz, not {given}; leave out --fps")
    if float(recorded) != int(recorded):
        raise InvalidValueError(f"{demos.path} was recorded at {recorded:g} Hz, but LeRobot's format has whole numbers")
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
    layout: _Layout,
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


def _paths(features: Mapping[str, dict[str, Any]], ours: Mapping[str, str]) -> dict[str, str]:
    """The HDF5 path of each feature that has one; vectors of ours are taken apart later."""
    known = {"action": "actions", _REWARD: "rewards", _DONE: "dones"}
    paths = {}
    for key, feature in features.items():
        plain = key.replace(".", "_").replace("/", "_")
        if feature["dtype"] == "string" or len(feature["shape"]) > _MOST_DIMS:
            continue
        if key in known:
            paths[key] = known[key]
        elif feature["dtype"] in ("image", "video"):
            if 3 in (feature["shape"][0], feature["shape"][-1]):
                camera = plain.removeprefix("observation_").removeprefix("images_")
                paths[key] = f"obs/{camera}_image"
        elif key.startswith("observation."):
            paths[key] = f"obs/{plain.removeprefix('observation_')}"
        else:
            paths[key] = ours.get(key, plain)
    return paths


def _unpack(
    file: Mapping[str, np.ndarray],
    features: Mapping[str, dict[str, Any]],
    paths: Mapping[str, str],
    flat: Sequence[str],
) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    for key, path in paths.items():
        parts = _parts(features[key]["names"]) if key in (_STATE, _ENVIRONMENT) else None
        if parts is None:
            arrays[path] = file[key]
        else:
            arrays |= {f"obs/{part}": file[key][:, columns] for part, columns in parts.items()}
    arrays |= {path: array[:, 0] for path, array in arrays.items() if path in flat}
    steps = len(arrays["actions"])
    dones = arrays["dones"] if "dones" in arrays else np.arange(steps) == steps - 1
    return {**arrays, "dones": dones.astype(np.int64)}


def _parts(names: Any) -> dict[str, list[int]] | None:
    """The columns of each key in a vector with names ``<key>.0``, ``<key>.1``, ...; None if it has others."""
    if not isinstance(names, list) or not names:
        return None
    parts: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        key, dot, number = str(name).rpartition(".")
        if not dot or number != str(len(parts.get(key, ()))) or "/" in key:
            return None
        parts.setdefault(key, []).append(column)
    return parts
