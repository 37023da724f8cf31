"""The episodes already done, on disk after each, so that a stopped transfer goes on where it was."""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ocplanner.errors import OutputError
from ocplanner.storage import atomic_write, writing
from ocplanner.transfer.result import Run


class Journal:
    """A file of lines: what is being run, then one episode a line.

    Args:
        path: the file.
        identity: whatever decides the episodes' outcome; JSON-able.

    Raises:
        OutputError: the file belongs to a transfer of another identity.
    """

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path = path
        self.runs: dict[int, Run] = {}
        identity = json.loads(json.dumps(identity))
        if not path.exists():
            with atomic_write(path) as temporary:
                temporary.write_text(json.dumps(identity) + "\n", encoding="utf-8")
            return
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        try:
            found = json.loads(lines[0])
        except (IndexError, ValueError):
            found = {}
        if found != identity:
            differing = sorted(key for key in {*found, *identity} if found.get(key) != identity.get(key))
            raise OutputError(
                f"{path} holds episodes run with another {', '.join(differing)}; finish that transfer with its own "
                "settings, delete the file, or choose another output"
            )
        whole = lines[0]
        for line in lines[1:]:
            if not line.endswith("\n"):  # the kill came in the middle of it
                break
            run = Run(**json.loads(line))
            self.runs[run.seed] = run
            whole += line
        if whole != "".join(lines):
            with atomic_write(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")

    def add(self, run: Run) -> None:
        """Keep one episode; when this returns it survives a kill."""
        with writing(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(run)) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self.runs[run.seed] = run

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)
