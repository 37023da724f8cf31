"""HDF5 files for reading: opened lazily in each process, with one clear :class:`DatasetError` for each fault."""

import contextlib
import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ocplanner.errors import DatasetError

HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
"""The first bytes of every HDF5 file."""

# What h5py and the decoding of text raise for files that are truncated, damaged or laid out differently. TypeError and
# AttributeError are not among them: they are mistakes in the program.
_BROKEN = (OSError, KeyError, RuntimeError, ValueError)
_DAMAGED = "the file is truncated, damaged or not robomimic's: download or record it again"
_LONGEST_COMMAND = 60
_MEMORY = "free some memory or use fewer workers; if the file cannot hold that much, download or record it again"


class HDF5File:
    """A file opened for reading; picklable, and usable after a fork or a spawn.

    Every error names the file, the key inside it, the fault and the remedy.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._handle: tuple[int, h5py.File] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """The path, never the open file."""
        return {"path": self.path, "_handle": None}

    def close(self) -> None:
        """Close the file; the next read opens it again."""
        if self._handle is not None and self._handle[0] == os.getpid():
            self._handle[1].close()
        self._handle = None

    def error(self, key: str, fault: str, remedy: str) -> DatasetError:
        """The error about ``key`` in this file."""
        return DatasetError(f"{self.path}: {key}: {fault}; {remedy}")

    @contextlib.contextmanager
    def reading(self, key: str) -> Iterator[h5py.File]:
        """The open file; damage or a lack of memory in the block becomes a :class:`DatasetError` about ``key``."""
        handle = self._open()
        try:
            yield handle
        except MemoryError as error:
            raise self.error(key, f"not enough memory ({_first_line(error)})", _MEMORY) from error
        except _BROKEN as error:
            raise self.error(key, f"cannot be read ({_first_line(error)})", _DAMAGED) from error

    def has(self, key: str) -> bool:
        """Whether the file has an item at ``key``."""
        with self.reading(key) as handle:
            return key in handle

    def names(self, key: str) -> tuple[str, ...]:
        """The names in the group at ``key``; empty if there is no such group."""
        with self.reading(key) as handle:
            item = handle.get(key)
            return self._texts(key, item) if isinstance(item, h5py.Group) else ()

    def attributes(self, key: str) -> dict[str, Any]:
        """The attributes of the item at ``key``, bytes decoded to text."""
        with self.reading(f"attributes of {key}") as handle, self._known_types(key):
            attributes = handle[key].attrs
            return {name: _text(attributes[name]) for name in self._texts(key, list(attributes))}

    def shape(self, key: str) -> tuple[int, ...]:
        """The shape of the array at ``key``."""
        with self.reading(key) as handle:
            return self._array(handle, key).shape

    def read(
        self,
        key: str,
        rows: slice | np.ndarray = slice(None),
        check: Callable[[tuple[int, ...]], None] | None = None,
    ) -> np.ndarray:
        """The array at ``key``, or some of its rows (an index array must increase).

        ``check`` is called with the shape of the whole array before anything is read.
        """
        with self.reading(key) as handle:
            array = self._array(handle, key)
            if check is not None:
                check(array.shape)
            return np.asarray(array[_as_slice(rows)])

    def arrays(self, key: str) -> tuple[str, ...]:
        """The paths, relative to the group at ``key``, of all arrays below it, linked ones too."""
        found: list[str] = []

        def collect(group: h5py.Group, above: str, within: tuple[h5py.Group, ...]) -> None:
            for name in self._texts(key, list(group)):
                item = group[name]
                if isinstance(item, h5py.Dataset):
                    found.append(above + name)
                elif isinstance(item, h5py.Group) and item not in within:  # a link may lead back up
                    collect(item, f"{above}{name}/", (*within, item))

        with self.reading(key) as handle:
            group = handle[key]
            if isinstance(group, h5py.Group):
                collect(group, "", (group,))
        return tuple(found)

    def copy(self, key: str, target: h5py.Group, name: str) -> None:
        """Copy the item at ``key`` to another open file, block by block, without decompressing it."""
        with self.reading(key) as handle:
            handle.copy(key, target, name=name, expand_soft=True, expand_external=True)

    def _texts(self, key: str, names: Collection[str | bytes]) -> tuple[str, ...]:
        """Names of items below ``key``; h5py gives those that are not UTF-8 as bytes."""
        texts = tuple(name for name in names if isinstance(name, str))
        if len(texts) < len(names):
            raise self.error(key, "holds a name that is not UTF-8", _DAMAGED)
        return texts

    def _array(self, handle: h5py.File, key: str) -> h5py.Dataset:
        item = handle.get(key)
        if item is None:
            parent = key.rpartition("/")[0]
            held = ", ".join(self.names(parent)[:12]) or "nothing"
            raise self.error(key, "not there", f"{parent} holds: {held}")
        if not isinstance(item, h5py.Dataset) or item.ndim == 0:
            raise self.error(key, "not an array", "this is no robomimic data set")
        with self._known_types(key):
            _ = item.dtype
        return item

    @contextlib.contextmanager
    def _known_types(self, key: str) -> Iterator[None]:
        """Report HDF5 types that NumPy lacks; h5py raises TypeError for them."""
        try:
            yield
        except TypeError as error:
            raise self.error(key, f"of an unknown type ({_first_line(error)})", _DAMAGED) from error

    def _open(self) -> h5py.File:
        if self._handle is not None and self._handle[0] == os.getpid():
            return self._handle[1]
        if self.path.is_dir():
            raise DatasetError(
                f"{self.path}: a folder, not an HDF5 file; name the file in it, or make one of a LeRobot data set with "
                "`ocplanner convert SOURCE TARGET`"
            )
        if not self.path.is_file():
            raise DatasetError(f"{self.path}: no such file; give the path of a robomimic HDF5 data set")
        try:
            handle = h5py.File(self.path, "r")
        except _BROKEN as error:
            raise DatasetError(f"{self.path}: {_why_unreadable(self.path, error)}") from error
        self._handle = (os.getpid(), handle)
        return handle


def _why_unreadable(path: Path, error: Exception) -> str:
    """Why a file could not be opened, and the remedy."""
    reason = _first_line(error)
    if "unable to lock file" in reason:
        holders = _holders(path)
        if holders:
            return (
                f"{' and '.join(holders)} has it open for writing; wait until that has finished, or end it. To read "
                "it as it stands, set HDF5_USE_FILE_LOCKING=FALSE"
            )
        return (
            "another process has it open for writing; wait until that has finished. None is seen on this machine: it "
            "may run on another one, or the file system may lack locks; if so, set HDF5_USE_FILE_LOCKING=FALSE"
        )
    if "already open for write" in reason:
        return f"a process has it open for writing, or was killed while it had ({reason}); wait, or record it again"
    if isinstance(error, PermissionError):
        return f"no permission to read it ({reason}); change its mode or copy it"
    return (
        f"not a readable HDF5 file ({reason}); it is truncated, damaged or of another kind: download or record it again"
    )


def _holders(path: Path) -> list[str]:
    """The processes of this machine that hold a lock on a file, as far as Linux shows them to us."""
    found = []
    with contextlib.suppress(OSError, ValueError):
        wanted = path.stat()
        for lock in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            *_, number, place, _, _ = lock.split()
            process = Path("/proc", number)
            if place.endswith(f":{wanted.st_ino}") and _has_open(process, wanted):
                command = (process / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ")
                found.append(f"process {number} ({' '.join(command.split())[:_LONGEST_COMMAND]})")
    return found


def _has_open(process: Path, wanted: os.stat_result) -> bool:
    for handle in (process / "fd").iterdir():
        with contextlib.suppress(OSError):  # closed since
            if os.path.samestat(handle.stat(), wanted):
                return True
    return False


def _as_slice(rows: slice | np.ndarray) -> slice | np.ndarray:
    """Adjacent rows as a slice: HDF5 reads it many times faster than a list."""
    if isinstance(rows, slice) or rows.dtype.kind not in "iu" or len(rows) == 0:
        return rows
    first, last = int(rows[0]), int(rows[-1])
    increasing = last - first + 1 == len(rows) and first >= 0 and bool(np.all(np.diff(rows) == 1))
    return slice(first, last + 1) if increasing else rows


def _text(value: Any) -> Any:
    return value.decode() if isinstance(value, bytes) else value


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].strip("'\"")
