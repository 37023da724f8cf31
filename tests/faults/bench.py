"""A verb at work in a folder of its own, and its undisturbed result to compare with."""

import os
import random
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import folders
from process import Ending, VerbProcess
from rows import Row
from verbs import Material, Verb

_POLL_S = 0.001


@dataclass(frozen=True)
class Reference:
    """An undisturbed run.

    Attributes:
        folder: what it wrote.
        span_s: seconds from its first file to its end.
        appearances: how often a file appeared, was replaced or vanished.
        size: bytes written.
    """

    folder: Path
    span_s: float
    appearances: int
    size: int


class Bench:
    """Where one verb is disturbed. Every run writes to the same path, so that results can name it.

    Args:
        folder: for everything; the verb works in ``disk/work`` below it.
        verb: what runs.
        material: its inputs.

    Attributes:
        rng: draws the moments and places of the faults.
    """

    def __init__(self, folder: Path, verb: Verb, material: Material) -> None:
        self.disk = folder / "disk"
        self.work = self.disk / "work"
        self.verb, self.material = verb, material
        self.rng = random.Random()  # noqa: S311 - moments, not secrets
        self._folder = folder
        self._reference: Reference | None = None
        self.clear()

    @property
    def output(self) -> Path:
        """The last file that the verb writes."""
        return self.work / (self.verb.output or "")

    @property
    def reference(self) -> Reference:
        """The undisturbed run, made once."""
        if self._reference is None:
            self.clear()
            running = self.start()
            seen, appearances, first = frozenset(), 0, None
            while (ending := running.poll()) is None:
                now = self.appeared()
                if now != seen:
                    first, seen, appearances = first or time.monotonic(), now, appearances + 1
                time.sleep(_POLL_S)
            if ending.code:
                raise RuntimeError(f"{self.verb.name} fails undisturbed: {ending.text}")
            span = time.monotonic() - (first or time.monotonic())
            kept = self._folder / "reference" / self.verb.name
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(self.work, kept)
            size = sum(path.stat().st_size for path in folders.files(kept).values())
            self._reference = Reference(kept, span, appearances, size)
            self.clear()
        return self._reference

    def clear(self) -> None:
        """Begin anew with an empty folder."""
        shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir(parents=True)

    def start(self, largest_file: int | None = None, log: str = "log", **instead: Path) -> VerbProcess:
        """Start the verb."""
        command = self.verb.command(self.material, self.work, **instead)
        return VerbProcess(command, self._folder / log, largest_file)

    def appeared(self) -> frozenset[tuple[str, int]]:
        """Names and numbers of all files there are, hidden ones included."""
        return frozenset((entry.path, entry.inode()) for entry in _walk(self.work))

    def await_work(self, running: VerbProcess) -> None:
        """Wait until the process has written its first file, or is at its end."""
        while running.poll() is None and not self.appeared():
            time.sleep(_POLL_S)

    def finish(self, row: Row) -> bool:
        """Run the same command to its end; whether the result is whole and equals the undisturbed one."""
        return self.judge(self.start().wait(), row)

    def judge(self, ending: Ending, row: Row) -> bool:
        """Whether a process ended well with the undisturbed result; the row hears if not."""
        # Killed after its last write, the same command finds its work done and must not do it again.
        complete = ending.clear and "exists already" in ending.text
        if ending.code and not complete:
            row.wonder(ending.complaint)
            return False
        found = folders.differences(self.reference.folder, self.work)
        if found:
            row.lose("; ".join(found[:4]))
            return False
        if row.compared != "arrays":
            row.compared = folders.compared_as(self.reference.folder, self.work)
        return True

    def check_whole(self, row: Row, safe: float) -> float:
        """Nothing visible may be half-written, nothing that was safe be gone; how much is safe now."""
        broken = folders.half_written(self.work)
        if broken:
            row.lose("; ".join(broken))
            return safe
        complete = not self.verb.grows and self.output.exists()
        now = float("inf") if complete else folders.progress(self.work)
        if now < safe:
            row.lose(f"progress fell from {safe:g} to {now:g}")
        return now


def _walk(folder: Path) -> list[os.DirEntry[str]]:
    found: list[os.DirEntry[str]] = []
    waiting = [os.fspath(folder)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    found.append(entry)
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
        except FileNotFoundError:  # gone since it was listed
            continue
    return found
