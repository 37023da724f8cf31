"""The episodes already done, on disk after each, so that a stopped transfer goes on where it was."""

import json
import os
from pathlib import Path
from typing import Any

from ocplanner.errors import OutputError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_write, writing


class Journal:
    """A file of lines: what is being run, then one episode a line, and whether it was filmed.

    An episode that was run again stands twice; the later line holds.

    Args:
        path: the file.
        identity: whatever decides the episodes' outcome; JSON-able.

    Raises:
        OutputError: the file belongs to a transfer of another identity, or is damaged.
    """

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path = path
        self.runs: dict[int, EpisodeResult] = {}
        self.filmed: set[int] = set()
        identity = json.loads(json.dumps(identity))
        if not path.exists():
            with atomic_write(path) as temporary:
                temporary.write_text(json.dumps(identity) + "\n", encoding="utf-8")
            return
        try:
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            whole = self._take(lines, identity)
        except (ValueError, TypeError, AttributeError, IndexError) as error:
            raise OutputError(
                f"{path} is damaged ({error}); delete it, and its episodes are run again, or choose another output"
            ) from error
        if whole != "".join(lines):
            with atomic_write(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")

    def _take(self, lines: list[str], identity: dict[str, Any]) -> str:
        """Note the episodes that stand in the lines; gives the text up to the last whole line."""
        found = json.loads(lines[0])
        if found != identity:
            differing = sorted(key for key in {*found, *identity} if found.get(key) != identity.get(key))
            raise OutputError(
                f"{self.path} holds episodes run with another {', '.join(differing)}; finish that run with its own "
                "settings, delete the file, or choose another output"
            )
        whole = lines[0]
        for line in lines[1:]:
            if not line.endswith("\n"):  # the kill came in the middle of it
                break
            content = json.loads(line)
            self._note(filmed=content.pop("filmed", False), run=EpisodeResult(**content))
            whole += line
        return whole

    def _note(self, run: EpisodeResult, *, filmed: bool) -> None:
        self.runs[run.seed] = run
        (self.filmed.add if filmed else self.filmed.discard)(run.seed)

    def add(self, run: EpisodeResult, *, filmed: bool = False) -> None:
        """Keep one episode, and that its video is written if it is; when this returns it survives a kill."""
        with writing(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({**run.to_json(), "filmed": filmed}) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._note(run, filmed=filmed)

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)
