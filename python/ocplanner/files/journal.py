"""The episodes done so far, on disk after each, so that a stopped run goes on where it was."""

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ocplanner.errors import OutputError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_write, writing
from ocplanner.settings import build


class Journal:
    """A file of lines: first what is being run, then one episode a line, with whether it was filmed.

    An episode that was run again stands twice; the later line counts.

    Args:
        path: the file.
        identity: everything that decides the episodes' outcome, as JSON types.

    Attributes:
        runs: the episodes by seed.
        filmed: seeds of the episodes whose video is written.

    Raises:
        OutputError: the file belongs to a run of another identity, or is damaged.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any]) -> None:
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
            whole = self._read(lines, identity)
        except (ValueError, TypeError, AttributeError, LookupError) as error:
            raise OutputError(
                f"{path} is damaged ({error}); delete it, and its episodes are run again, or choose another output"
            ) from error
        if whole != "".join(lines):
            with atomic_write(path) as temporary:
                temporary.write_text(whole, encoding="utf-8")

    def _read(self, lines: list[str], identity: Mapping[str, Any]) -> str:
        """Note the episodes in the lines; returns the text up to the last whole line."""
        found, wanted = dict(_flat(json.loads(lines[0]))), dict(_flat(identity))
        if found != wanted:
            differing = sorted(key for key in {*found, *wanted} if found.get(key) != wanted.get(key))
            raise OutputError(
                f"{self.path} holds episodes run with another {', '.join(differing)}; finish that run with its own "
                "settings, delete the file, or choose another output"
            )
        whole = lines[0]
        for line in lines[1:]:
            if not line.endswith("\n"):  # the kill came in the middle of it
                break
            content = json.loads(line)
            filmed = content.pop("filmed", False)
            self._note(build(EpisodeResult, content), filmed=filmed)
            whole += line
        return whole

    def _note(self, run: EpisodeResult, *, filmed: bool) -> None:
        self.runs[run.seed] = run
        (self.filmed.add if filmed else self.filmed.discard)(run.seed)

    def add(self, run: EpisodeResult, *, filmed: bool = False) -> None:
        """Keep one episode, and whether its video is written; when this returns, it survives a kill."""
        with writing(self.path), self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({**run.to_json(), "filmed": filmed}) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._note(run, filmed=filmed)

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The entries of nested mappings under dotted names."""
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
