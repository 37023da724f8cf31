"""Find what a report can show in files and folders: runs, results, planners, policies, videos and pictures."""

import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from ocplanner.errors import ResultFileError
from ocplanner.files.records.metrics import METRICS
from ocplanner.files.records.transfer import is_matrix, is_transfer
from ocplanner.files.storage import natural_key
from ocplanner.policies.config import POLICY_FILE
from ocplanner.report.policy_results import PolicyRecord, is_evaluation, read_evaluation
from ocplanner.report.runs import TrainingRun, read_run
from ocplanner.zero_shot.result import TransferResult, read_results

PICTURES = (".png", ".svg")
WEIGHTS = ".safetensors"
_FIGURES = "figures"
_POLICIES = "policies"
_SKIPPED = ("checkpoints", "tensorboard", "node_modules", "__pycache__")


@dataclass(frozen=True)
class Sources:
    """What was found, each in the order of the paths given, then by name."""

    runs: tuple[TrainingRun, ...]
    records: tuple[TransferResult, ...]
    videos: tuple[Path, ...]
    figures: tuple[Path, ...]
    planners: tuple[Path, ...]
    policies: tuple[Path, ...]
    evaluations: tuple[PolicyRecord, ...]

    @property
    def planner_runs(self) -> list[TrainingRun]:
        """Those that trained a planner."""
        return [run for run in self.runs if not run.of_policy]

    @property
    def policy_runs(self) -> list[TrainingRun]:
        """Those that trained a policy."""
        return [run for run in self.runs if run.of_policy]


def find_sources(paths: Iterable[str | Path]) -> Sources:
    """Look through files and folders.

    A folder with ``metrics.jsonl`` is a run; a JSON file with episodes, or a matrix of them, is a result, one with the
    checkpoints of a policy an evaluation; every mp4 is an episode; a safetensors file is a policy if it says so and
    otherwise a planner; of the policies in a run folder only the last is taken; pictures count when they lie in a
    folder called ``figures``. A file named outright must be one of these, and is always taken.

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
    json_files = {file: _content(file) for file in unique if file.suffix == ".json"}
    evaluations = [file for file, content in json_files.items() if is_evaluation(content)]
    weights = {file: _is_policy(file) for file in unique if file.suffix == WEIGHTS}
    sources = Sources(
        runs=tuple(read_run(file.parent) for file in unique if file.name == METRICS),
        records=_distinct(record for file in json_files if file not in evaluations for record in read_results(file)),
        videos=tuple(file for file in unique if file.suffix == ".mp4"),
        figures=tuple(file for file in unique if file.suffix in PICTURES),
        planners=tuple(file for file, is_policy in weights.items() if not is_policy),
        policies=tuple(file for file, is_policy in weights.items() if is_policy),
        evaluations=tuple(read_evaluation(file) for file in evaluations),
    )
    if not unique:
        raise ResultFileError(
            f"nothing to report in {', '.join(map(str, paths))}: "
            "no metrics.jsonl, result, planner, policy, mp4 or figures"
        )
    return sources


def _distinct(records: Iterable[TransferResult]) -> tuple[TransferResult, ...]:
    """Records without repetitions: a matrix and its cells' own files hold the same."""
    found = {}
    for record in records:
        found.setdefault((record.conditions, record.planner_sha256, record.runs), record)
    return tuple(found.values())


def _files(folder: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(
            (name for name in folders if not name.startswith(".") and name not in _SKIPPED), key=natural_key
        )
        yield from (Path(parent) / name for name in sorted(files, key=natural_key) if not name.startswith("."))


def _shown(file: Path) -> bool:
    if file.suffix == ".json":
        return _holds_results(file)
    if file.suffix == WEIGHTS:
        return not _superseded(file)
    return file.name == METRICS or file.suffix == ".mp4" or (file.suffix in PICTURES and file.parent.name == _FIGURES)


def _superseded(file: Path) -> bool:
    """Whether a run folder keeps a later policy than this one in its ``policies``."""
    run = file.parent.parent
    if file.parent.name != _POLICIES or not (run / METRICS).exists():
        return False
    return (run / POLICY_FILE).exists() or file.name < max(other.name for other in file.parent.glob(f"*{WEIGHTS}"))


def _is_policy(file: Path) -> bool:
    """By what the file says of itself; one that cannot be read is left to the planner's loader to refuse."""
    try:
        with safe_open(file, framework="numpy") as opened:
            return json.loads((opened.metadata() or {})["ocplanner"])["kind"] == "policy"
    except (SafetensorError, OSError, KeyError, TypeError, ValueError):
        return False


def _named(file: Path) -> Path:
    if file.name == METRICS or file.suffix in (".json", ".mp4", WEIGHTS, *PICTURES):
        return file
    raise ResultFileError(
        f"cannot report on {file}: give a run folder, {METRICS}, a result of `transfer` or `evaluate` (.json), a "
        "planner or policy (.safetensors), a video (.mp4) or a picture"
    )


def _content(file: Path) -> Any:
    """Parsed JSON; None if it cannot be read."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError):
        return None


def _holds_results(file: Path) -> bool:
    content = _content(file)
    return is_transfer(content) or is_matrix(content) or is_evaluation(content)
