"""Writing robomimic HDF5 files so that a kill at any moment loses at most one unfinished demonstration.

If a process dies while it writes an HDF5 file, the whole file is lost. Each demonstration is therefore first written to
a small file of its own in the folder ``<target>.parts`` (under a temporary name, then renamed). When all are there,
they are copied block by block into the target, which appears complete or not at all. Each part ends with its SHA-256,
which HDF5 ignores: an interrupted writer does not resume from a part that was damaged since.
"""

import contextlib
import io
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError, OutputError
from ocplanner.files.storage import (
    atomic_json,
    atomic_write,
    check_output,
    locked,
    natural_key,
    output_error,
    seal,
    sealed,
)

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_HEADER = "header.json"
_OWN = re.compile(r"header\.json|\..*\.partial")
_SOURCE = "source"
_BIG_FROM_DIMS = 3  # arrays with so many dimensions hold images: one chunk a frame, for random access


class DatasetWriter:
    """Collects demonstrations into one robomimic file; a context manager that can be interrupted.

    A writer continues from the parts of an interrupted one with the same ``env_args`` and ``data_attrs``. A part that
    was made from another data set's demonstration of the same name is told apart by a digest of its source.

    >>> with DatasetWriter(path, env_args, reads=[demos.path]) as writer:                # doctest: +SKIP
    ...     for demo in demos:
    ...         if not writer.holds(demo.name, demo.digest()):
    ...             writer.add(demo.name, demo.arrays(), demo.attrs, demo.digest())
    ...     writer.finish({"train": names})

    Args:
        path: the file to make; :meth:`finish` makes it.
        env_args: robomimic's description of the environment; empty if nothing describes it.
        data_attrs: further attributes of ``data`` (``ocplanner_render``, ...): text and numbers.
        overwrite: replace an existing file at ``path``.
        durable: whether each demonstration survives a power cut, not only a kill. If False, a part that a power cut
            damaged is reported when the writer resumes; the finished file is safe in both cases.
        reads: the files that the demonstrations are made from; they are never replaced.

    Raises:
        OutputError: ``path`` exists or is read, another process is writing it, the folder is not writable, or the parts
            of an interrupted writer are damaged or were made with other settings.
    """

    def __init__(
        self,
        path: str | Path,
        env_args: Mapping[str, Any],
        *,
        data_attrs: Mapping[str, Any] | None = None,
        overwrite: bool = False,
        durable: bool = True,
        reads: Iterable[str | Path | None] = (),
    ) -> None:
        self.path, self._durable = Path(path), durable
        check_output(self.path, overwrite, "HDF5 data set", reads, resumed=True)
        self.parts = self.path.with_name(f"{self.path.name}.parts")
        described = {"env_args": json.dumps(dict(env_args))} if env_args else {}
        self._attrs: dict[str, Any] = {**described, **{key: _plain(value) for key, value in (data_attrs or {}).items()}}
        self._resources = contextlib.ExitStack()
        self._resources.enter_context(locked(self.path))
        try:
            if self.path.exists() and not overwrite and self._finished():
                self._discard_parts()
            check_output(self.path, overwrite, "HDF5 data set")
            self._open_parts()
            self._resources.callback(self._discard_nothing)
        except BaseException:
            self._resources.close()
            raise

    @property
    def done(self) -> tuple[str, ...]:
        """The names of the demonstrations that are safely on disk, in natural order."""
        return tuple(sorted((part.stem for part in self.parts.glob("*.hdf5")), key=natural_key))

    def holds(self, name: str, source: str) -> bool:
        """Whether a demonstration is safely on disk that was made from this source.

        Args:
            name: the demonstration.
            source: digest of what it is made from, as given to :meth:`add`.

        Raises:
            OutputError: the one on disk was made from something else, by an interrupted writer for another data set.
        """
        part = self.parts / f"{name}.hdf5"
        if not part.exists():
            return False
        with _saving(part), h5py.File(part, "r") as file:
            found = file.attrs.get(_SOURCE)
        if found != source:
            raise OutputError(
                f"{part} was made from another {name} than the source's now, by a run that was stopped; run that one's "
                f"command to finish it, delete {self.parts} to start again, or choose another output"
            )
        return True

    def add(
        self,
        name: str,
        arrays: Mapping[str, np.ndarray],
        attrs: Mapping[str, Any] | None = None,
        source: str | None = None,
    ) -> None:
        """Store one demonstration. From the return on it survives a kill.

        Args:
            name: such as ``demo_3``; an earlier demonstration of this name is replaced.
            arrays: by path (``actions``, ``states``, ``obs/agentview_image``, ...); the first dimension of each counts
                the steps, and ``actions`` is required.
            attrs: attributes of the demonstration; ``num_samples`` is added.
            source: digest of what it is made from, for :meth:`holds`; the finished file does not hold it.

        Raises:
            DatasetError: the name is not allowed, or the arrays do not fit together.
            OutputError: the disk is full or the folder is gone.
        """
        steps = _check(name, arrays)
        with self._part(name, source) as file:
            group = file.create_group("demo")
            group.attrs.update({**(attrs or {}), "num_samples": steps})
            _store(group, arrays)

    def add_copy(self, demo: Demonstration, arrays: Mapping[str, np.ndarray], source: str | None = None) -> None:
        """Store a copy of another file's demonstration with added or replaced arrays.

        Compressed data are copied as they are, so that images cost neither time nor memory.

        Args:
            demo: the demonstration; the copy has the same name.
            arrays: by path, as for :meth:`add`.
            source: as for :meth:`add`.

        Raises:
            DatasetError: the demonstration cannot be read, or the arrays do not fit it.
            OutputError: the disk is full or the folder is gone.
        """
        steps = _check(demo.name, {"actions": demo.actions, **arrays})
        with self._part(demo.name, source) as file:
            demo.copy_to(file, "demo")
            group = file.require_group("demo")
            group.attrs["num_samples"] = steps
            for key in arrays:
                if key in group:
                    del group[key]
            _store(group, arrays)

    def finish(self, masks: Mapping[str, Sequence[str]] | None = None, names: Sequence[str] | None = None) -> Path:
        """Copy the demonstrations into the target file, with bounded memory, and remove the parts.

        Args:
            masks: lists of demonstration names under ``mask/``.
            names: the demonstrations to keep; all in :attr:`done` if None.

        Raises:
            DatasetError: a named demonstration is missing, or there is none.
            OutputError: the disk is full or the folder is gone.
        """
        done = self.done
        names = done if names is None else names
        absent = sorted({*names, *(name for mask in (masks or {}).values() for name in mask)} - set(done))
        if absent or not names:
            raise DatasetError(
                f"{self.path}: cannot be finished without {', '.join(absent[:3]) or 'any demonstration'}; add what is "
                "missing first"
            )
        with _saving(self.path), atomic_write(self.path) as temporary, _create(temporary) as file:
            data = file.create_group("data")
            total = 0
            for name in names:
                with h5py.File(self.parts / f"{name}.hdf5", "r") as part:
                    part.copy("demo", data, name=name)
                total += int(np.asarray(data.require_group(name).attrs["num_samples"]).item())
            data.attrs.update({**self._attrs, "total": total})
            for mask, listed in (masks or {}).items():
                file.create_dataset(f"mask/{mask}", data=np.array([name.encode() for name in listed], dtype="S"))
        self._discard_parts()
        self.close()
        return self.path

    def close(self) -> None:
        """Release the output; a later writer can resume from what was added."""
        self._resources.close()

    def __enter__(self) -> Self:
        """The writer has locked its output since it was made."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the output."""
        self.close()

    @contextlib.contextmanager
    def _part(self, name: str, source: str | None) -> Iterator[h5py.File]:
        """A new file for one demonstration; it appears when the block ends."""
        with _saving(self.path), atomic_write(self.parts / f"{name}.hdf5", self._durable) as temporary:
            with _create(temporary) as file:
                if source is not None:
                    file.attrs[_SOURCE] = source
                yield file
            seal(temporary)

    def _header(self) -> dict[str, Any]:
        header = self.parts / _HEADER
        try:
            found = json.loads(header.read_text(encoding="utf-8"))
            if not isinstance(found, dict):
                raise ValueError(f"{type(found).__name__} instead of an object")
        except (OSError, ValueError) as error:
            raise OutputError(f"{header} is damaged ({error}); delete {self.parts} and start again") from error
        return found

    def _finished(self) -> bool:
        """Whether the parts are leftovers, because a kill came between the target's appearance and their removal."""
        if not self.parts.is_dir():
            return False
        if not (self.parts / _HEADER).exists():
            return all(_is_own(item) for item in self.parts.iterdir())
        with contextlib.suppress(OutputError, OSError, KeyError, RuntimeError), h5py.File(self.path, "r") as file:
            data = file["data"]
            made = {key: _plain(data.attrs[key]) for key in self._header()}
            return made == self._header() and isinstance(data, h5py.Group) and {*self.done} <= {*data}
        return False

    def _open_parts(self) -> None:
        header = self.parts / _HEADER
        if header.exists() and self.done:
            found = self._header()
            if found != self._attrs:
                differing = sorted(key for key in {*found, *self._attrs} if found.get(key) != self._attrs.get(key))
                raise OutputError(
                    f"{self.parts} has demonstrations made with another {', '.join(differing)}; "
                    "run with the settings as before, delete that folder, or choose another output"
                )
            damaged = [str(part) for part in sorted(self.parts.glob("*.hdf5")) if not sealed(part)]
            if damaged:
                raise OutputError(
                    f"{', '.join(damaged[:3])}{' and others' * (len(damaged) > 3)}: damaged since written; delete "
                    f"{'them' if len(damaged) > 1 else 'it'} and run the same command again, which makes only what is "
                    "missing"
                )
            return
        if self.parts.is_dir():
            foreign = sorted(item.name for item in self.parts.iterdir() if not _is_own(item))
            if foreign:
                raise OutputError(
                    f"{self.parts} holds {', '.join(foreign[:3])}; move that away or choose another output"
                )
            self._discard_parts()
        atomic_json(header, self._attrs)

    def _discard_nothing(self) -> None:
        """Remove the folder if it has no demonstration."""
        if self.parts.is_dir() and not self.done:
            self._discard_parts()

    def _discard_parts(self) -> None:
        # Without its header the folder counts as empty, so that a kill here leaves nothing to resume by mistake.
        with _saving(self.parts):
            (self.parts / _HEADER).unlink(missing_ok=True)
            for item in self.parts.iterdir():
                if _is_own(item):
                    item.unlink()
            with contextlib.suppress(OSError):  # what is not ours stays, and the folder with it
                self.parts.rmdir()


def _is_own(item: Path) -> bool:
    """Whether a writer made this file in a folder of parts, rather than somebody who keeps things there."""
    if item.is_symlink() or not item.is_file():
        return False
    if item.suffix == ".hdf5" and not item.name.startswith("."):
        return sealed(item)
    return _OWN.fullmatch(item.name) is not None


def _plain(value: Any) -> Any:
    """An attribute as JSON can hold it."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, str | int | float | bool | list) else str(value)


def _check(name: str, arrays: Mapping[str, np.ndarray]) -> int:
    if not _NAME.fullmatch(name):
        raise DatasetError(f"{name!r} cannot name a demonstration; use letters, digits, '_', '.' and '-'")
    if "actions" not in arrays:
        raise DatasetError(f"{name}: no actions among its arrays ({', '.join(arrays) or 'none'}); add them")
    steps = len(arrays["actions"])
    if steps == 0:
        raise DatasetError(f"{name}: no steps; leave it out")
    for key, array in arrays.items():
        if array.ndim == 0 or len(array) != steps:
            raise DatasetError(f"{name}: {key} has shape {array.shape}, but there are {steps} actions")
        if array.dtype.kind not in "fiub":
            raise DatasetError(f"{name}: {key} has dtype {array.dtype}, expected numbers")
    return steps


def _store(group: h5py.Group, arrays: Mapping[str, np.ndarray]) -> None:
    for key, array in arrays.items():
        if array.ndim < _BIG_FROM_DIMS:
            group.create_dataset(key, data=array)
        else:
            chunks = (1, *array.shape[1:])
            group.create_dataset(key, data=array, compression="gzip", compression_opts=4, chunks=chunks)


class _RememberingFile(io.FileIO):
    """A file that swallows the first failed write and remembers it.

    HDF5 ignores errors while it closes a data set, and may crash on a file whose metadata it could not write.
    """

    failure: OSError | None = None

    def write(self, data: Any, /) -> int:
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest and self.failure is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failure = error
        return size


@contextlib.contextmanager
def _create(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file.

    Raises:
        OSError: at the end of the block, if any write failed.
    """
    with _RememberingFile(str(path), "r+") as raw:
        try:
            with h5py.File(raw, "w") as file:
                yield file
        finally:
            if raw.failure is not None:
                raise raw.failure


@contextlib.contextmanager
def _saving(path: Path) -> Iterator[None]:
    """Turn a failed write into :class:`OutputError`; HDF5 reports a full disk as RuntimeError or OSError."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise output_error(path, error) from error
