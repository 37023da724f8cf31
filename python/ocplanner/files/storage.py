"""Writes files so that a kill, a full disk or a second process never leaves a half-written result."""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import re
import socket
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from ocplanner.errors import OutputError
from ocplanner.files.hdf5 import HDF5_MAGIC

_PIECE = 1 << 20
"""Bytes read at a time."""

_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space and run the same command again",
    errno.EDQUOT: "the disk quota is used up; free some space and run the same command again",
    errno.EACCES: "no permission to write there; choose another output folder",
    errno.EPERM: "no permission to write there; choose another output folder",
    errno.EROFS: "the folder is read-only; choose another output folder",
    errno.EFBIG: "the file is larger than the system allows; raise the limit or choose another output folder",
    errno.EEXIST: "a part of the path is a file, not a folder; choose another output path",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another output path",
    errno.EISDIR: "the path is a folder; give the name of a file",
}


OutputKind = Literal["HDF5 data set", "JSON result", "HTML page", "picture", "mp4 video", "safetensors file"]
"""What a verb writes."""


def check_output(
    path: Path, overwrite: bool, kind: OutputKind, reads: Iterable[str | Path | None] = (), *, resumed: bool = False
) -> None:
    """Check that an output may be written: the one rule of all verbs.

    What is read is never replaced, under whatever name. Another file is replaced only if that is allowed and it is of
    the kind that is written.

    Args:
        path: the output.
        overwrite: an existing file may be replaced.
        kind: what is written.
        reads: files and folders that are read to make it; None stands for one that is not given.
        resumed: an existing file is read and continued, so ``overwrite`` does not matter.

    Raises:
        OutputError: the path is a folder, a file that is read, or an existing file that must not be replaced.
    """
    _refuse_input(path, reads)
    if path.is_dir():
        raise OutputError(f"{str(path)!r} exists already as a folder; name a file")
    if kind == "JSON result" and path.suffix != ".json":  # the folder of its videos or cells has the name without it
        raise OutputError(f"{path} cannot be a result file: its name must end in .json; name it {path}.json")
    if not path.exists():
        return
    if not overwrite and not resumed:
        raise OutputError(
            f"{path} exists already; choose another file, or allow overwriting (--overwrite; overwrite=True)"
        )
    if not _is(kind, path):
        raise OutputError(
            f"{path} exists already and is no {kind}, so it is not replaced; choose another output, or delete it first"
        )


def check_folder(folder: Path, written: Iterable[str], mark: str, reads: Iterable[str | Path | None] = ()) -> None:
    """Check that a folder may be filled, as the run folder of a training is.

    Args:
        folder: the folder; it need not exist.
        written: names of what will be written into it.
        mark: the file that tells a folder of this kind from any other.
        reads: files that are read meanwhile; None stands for one that is not given.

    Raises:
        OutputError: it is the working directory or holds that, holds a file that is read, or belongs to something else.
    """
    whole = folder.resolve()
    if Path.cwd().is_relative_to(whole):
        raise OutputError(
            f"{str(folder)!r} cannot be the folder: the working directory is in it; name a folder of its own"
        )
    for read in reads:
        if read is not None and Path(read).resolve().is_relative_to(whole):
            raise OutputError(f"{folder} holds {read}, which is read; name a folder of its own")
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file; name a folder")
    foreign = [name for name in written if (folder / name).exists()]
    if foreign and not (folder / mark).exists():
        raise OutputError(
            f"{folder} has no {mark}, so its {', '.join(foreign[:3])} may be something else's; name another folder"
        )


def _refuse_input(path: Path, reads: Iterable[str | Path | None]) -> None:
    for read in map(Path, filter(None, reads)):
        if path.resolve() == read.resolve() or (path.exists() and read.exists() and path.samefile(read)):
            named = str(path) if str(path) == str(read) else f"{path} is {read}, which"
            raise OutputError(f"{named} is read to make the output and is never replaced; choose another output")


def _is(kind: OutputKind, path: Path) -> bool:
    """Whether a file is of a kind, by its content; an empty one is of any."""
    if not path.is_file():  # a device or a pipe
        return False
    with writing(path), path.open("rb") as file:
        start = file.read(512)
    if not start:
        return True
    if kind == "HDF5 data set":
        return start.startswith(HDF5_MAGIC)
    if kind == "HTML page":
        return start.lstrip().lower().startswith((b"<!doctype html", b"<html"))
    if kind == "picture":
        return start.startswith((b"\x89PNG", b"%PDF")) or b"<svg" in start
    if kind == "safetensors file":
        return start[4:9] == b"\0\0\0\0{"  # a header below 4 GiB
    if kind == "mp4 video":
        return start[4:8] == b"ftyp"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        return False
    return isinstance(content, dict) and not content.keys().isdisjoint(("command", "runs", "cells"))


def output_error(path: Path, error: BaseException) -> OutputError:
    """The :class:`OutputError` for ``error`` at ``path``, with its remedy."""
    number = getattr(error, "errno", None)
    text = str(error)
    if number is None and ("No space left" in text or f"errno = {errno.ENOSPC}" in text):
        number = errno.ENOSPC  # HDF5 gives the system's error number only in the text
    remedy = _REMEDIES.get(number or 0, "check the folder and run the same command again")
    return OutputError(f"cannot write {path}: {text.splitlines()[0] if text else type(error).__name__}; {remedy}")


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the operating system's errors in the block into an :class:`OutputError` about ``path``."""
    try:
        yield
    except OSError as error:
        raise output_error(path, error) from error


def sync_folder(folder: Path) -> None:
    """Make renames in ``folder`` survive a power cut, if the file system can sync folders."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def atomic_write(path: str | Path, durable: bool = True) -> Iterator[Path]:
    """Yield the name of a temporary file beside ``path``; after the block it is synced and renamed to ``path``.

    Until then ``path`` keeps its old content, or stays absent. If the block raises, the temporary file is removed.
    Temporary files that killed processes of this machine left for the same ``path`` are removed first.

    The block must write the temporary file itself. A function that writes and renames yet another file, such as
    ``save_file`` of safetensors, would leave that file behind if killed.

    Args:
        path: the file to make or replace.
        durable: wait until the data is on the disk. If false, a kill still leaves all or nothing, but a power cut may
            damage the file; for files whose damage can be detected and that are quick to make again.

    Raises:
        OutputError: the folder cannot be made or written, or the disk is full.
    """
    path = Path(path)
    prefix = f".{path.name}.{socket.gethostname()}-"
    temporary = path.with_name(f"{prefix}{os.getpid()}.partial")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path.parent, prefix)
        temporary.touch()
    try:
        with writing(path):
            yield temporary
            if durable:
                descriptor = os.open(temporary, os.O_RDWR)
                try:
                    os.fsync(descriptor)
                finally:
                    os.close(descriptor)
            temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    if durable:
        sync_folder(path.parent)


def seal(path: Path) -> None:
    """Append a file's SHA-256 to it, so that :func:`sealed` can detect later damage."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").digest()
        file.seek(0, os.SEEK_END)
        file.write(digest)


def sealed(path: Path) -> bool:
    """Whether a file is unchanged since :func:`seal`."""
    size = path.stat().st_size - hashlib.sha256().digest_size
    if size < 0:
        return False
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(min(size, _PIECE)):
            digest.update(piece)
            size -= len(piece)
        return file.read() == digest.digest()


def atomic_json(path: str | Path, value: Any) -> None:
    """Write ``value`` as indented JSON through :func:`atomic_write`; NaN and infinity raise ValueError."""
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def locked(path: str | Path) -> Iterator[None]:
    """Hold the right to write ``path``, a file or a folder; the lock ends with the process, even after ``kill -9``.

    Raises:
        OutputError: another process holds the lock, the lock file beside ``path`` cannot be made, or ``path`` has no
            name.
    """
    path = Path(path)
    if path.name in ("", ".."):
        raise OutputError(f"{str(path)!r} names no file or folder of its own; give a name")
    lock = path.with_name(f".{path.name}.lock")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = _acquire(path, lock)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            lock.unlink()
        os.close(descriptor)


def _acquire(path: Path, lock: Path) -> int:
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            raise OutputError(
                f"another process (pid {owner}) is writing {path}; wait for it or choose another output"
            ) from None
        except BaseException:
            os.close(descriptor)
            raise
        # The previous holder may have unlinked the file between our open and flock; then lock the new file.
        with contextlib.suppress(FileNotFoundError):
            if os.stat(lock).st_ino == os.fstat(descriptor).st_ino:
                os.ftruncate(descriptor, 0)
                os.pwrite(descriptor, str(os.getpid()).encode(), 0)
                return descriptor
        os.close(descriptor)


def _sweep(folder: Path, prefix: str) -> None:
    for stale in folder.glob(f"{_escape(prefix)}*.partial"):
        pid = stale.name[len(prefix) : -len(".partial")]
        if pid.isdigit() and not _alive(int(pid)):
            stale.unlink(missing_ok=True)


def _escape(text: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in text)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def natural_key(name: str) -> list[tuple[int, str]]:
    """Sort key that puts demo_2 before demo_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name) if part]
