"""A small disk of one's own, which can be full or read-only: a tmpfs, for root alone."""

import os
import subprocess
from pathlib import Path

_SIZE = 64 << 20
_PAGE = 4096


class SmallDisk:
    """A tmpfs mounted at a folder until it is closed.

    Raises:
        PermissionError: this machine does not let us mount.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        _system("mount", "-t", "tmpfs", "-o", f"size={_SIZE}", "tmpfs", str(folder))
        self._filler = folder / "filler"

    def leave_free(self, free: int) -> None:
        """Fill the disk up to so many bytes, in whole pages."""
        self._filler.unlink(missing_ok=True)
        state = os.statvfs(self._folder)
        with self._filler.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, state.f_bavail * state.f_frsize - max(_PAGE, free // _PAGE * _PAGE))

    def empty(self) -> None:
        """Make room."""
        self._filler.unlink(missing_ok=True)

    def read_only(self, switch: bool) -> None:
        """Forbid or allow writing."""
        _system("mount", "-o", f"remount,{'ro' if switch else 'rw'}", str(self._folder))

    def close(self) -> None:
        """Unmount."""
        _system("umount", str(self._folder))


def _system(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PermissionError(done.stderr.strip() or f"{command[0]} failed")
