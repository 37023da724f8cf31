"""Find what a report can show in files and folders: runs, transfer results, videos and pictures."""

import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ocplanner.errors import ResultFileError
from ocplanner.report.results import TransferRecord, is_result, read_results
from ocplanner.report.runs import METRICS, Run, read_run

PICTURES = (".png", ".svg")
PLANNER = ".safetensors"
_FIGURES = "figures"
_SKIPPED = ("checkpoints", "tensorboard", "node_modules", "__pycache__")


@dataclass(frozen=True)
class Sources:
    """What was found, each in the order of the paths given, then by name."""

    runs: tuple[Run, ...]
    records: tuple[TransferRecord, ...]
    videos: tuple[Path, ...]
    figures: tuple[Path, ...]
    planners: tuple[Path, ...]


def find_sources(paths: Iterable[str | Path]) -> Sources:
    """Look through files and folders.

    A folder with ``metrics.jsonl`` is a run; a JSON file with episodes, or a matrix of them, is a result; every mp4 is
    an episode; every safetensors file a planner; pictures count when they lie in a folder called ``figures``. A file
    named outright must be one of these.

    Raises:
        ResultFileError: a path is missing, a named file is of no kind known here, something found is damaged, or there
            is nothing to show at all.
    """
    found: dict[Path, None] = {}
    for path in map(Path, paths):
        if path.is_dir():
            found |= dict.fromkeys(file for file in _files(path) if _shown(file))
        elif path.is_file():
            found[_named(path)] = None
        else:
            raise ResultFileError(f"no such file or folder: {path}")
    unique = list({file.resolve(): file for file in found}.values())
    sources = Sources(
        runs=tuple(read_run(file.parent) for file in unique if file.name == METRICS),
        records=tuple(record for file in unique if file.suffix == ".json" for record in read_results(file)),
        videos=tuple(file for file in unique if file.suffix == ".mp4"),
        figures=tuple(file for file in unique if file.suffix in PICTURES),
        planners=tuple(file for file in unique if file.suffix == PLANNER),
    )
    if not unique:
        raise ResultFileError(
            f"nothing to report in {', '.join(map(str, paths))}: "
            "no metrics.jsonl, transfer result, planner, mp4 or figures"
        )
    return sources


def _files(folder: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(
            (name for name in folders if not name.startswith(".") and name not in _SKIPPED), key=_natural
        )
        yield from (Path(parent) / name for name in sorted(files, key=_natural) if not name.startswith("."))


def _natural(name: str) -> list[tuple[int, str]]:
    """Numbers inside names in order of value: h5 before h20."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


def _shown(file: Path) -> bool:
    if file.suffix == ".json":
        return _holds_results(file)
    return (
        file.name == METRICS
        or file.suffix in (".mp4", PLANNER)
        or (file.suffix in PICTURES and file.parent.name == _FIGURES)
    )


def _named(file: Path) -> Path:
    if file.name == METRICS or file.suffix in (".json", ".mp4", PLANNER, *PICTURES):
        return file
    raise ResultFileError(
        f"cannot report on {file}: give a run folder, {METRICS}, a transfer result (.json), a planner "
        "(.safetensors), a video (.mp4) or a picture"
    )


def _holds_results(file: Path) -> bool:
    try:
        content = json.loads(file.read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError):
        return False
    cells = content.get("cells") if isinstance(content, dict) else None
    return is_result(content) or (isinstance(cells, list) and bool(cells) and all(is_result(cell) for cell in cells))
