"""Find what a report can show in files and folders: runs, results, planners, policies, videos and pictures."""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from ocplanner.errors import ResultFileError
from ocplanner.files.records.evaluation import is_evaluation
from ocplanner.files.records.metrics import METRICS
from ocplanner.files.records.transfer import is_matrix, is_transfer
from ocplanner.files.storage import natural_key
from ocplanner.policies.config import POLICY_FILE
from ocplanner.report.policy_results import PolicyRecord, read_evaluation
from ocplanner.report.runs import TrainingRun, read_run
from ocplanner.zero_shot.result import TransferResult, read_results

_KINDS = {".mp4": "video", ".png": "figure", ".svg": "figure"}
_WEIGHTS = ".safetensors"
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
    files: tuple[Path, ...] = ()
    """What must not be replaced: all of these except pictures in folders, which a report may have drawn itself."""

    @property
    def planner_runs(self) -> list[TrainingRun]:
        """Those that trained a planner."""
        return [run for run in self.runs if not run.of_policy]

    @property
    def policy_runs(self) -> list[TrainingRun]:
        """Those that trained a policy."""
        return [run for run in self.runs if run.of_policy]


def find_sources(paths: Sequence[str | Path]) -> Sources:
    """Look through files and folders.

    A folder with ``metrics.jsonl`` is a run. A JSON file is a transfer, a matrix of transfers, or an evaluation of a
    policy. An mp4 is an episode. A safetensors file is a policy if its header says so, otherwise a planner; of the
    policies in a run folder only the last counts. Pictures count if they lie in a folder called ``figures``. A file
    named outright always counts.

    Raises:
        ResultFileError: a path is missing, a named file is of none of these kinds, a file is damaged, or there is
            nothing to show.
    """
    found: dict[Path, tuple[Path, str]] = {}
    named = {Path(path).resolve() for path in paths}
    for path in map(Path, paths):
        if path.is_dir():
            kinds = ((file, _kind(file)) for file in _files(path))
            found |= {file.resolve(): (file, kind) for file, kind in kinds if kind and _shown(file, kind)}
        elif path.is_file():
            found[path.resolve()] = path, _kind_of_named(path)
        else:
            raise ResultFileError(f"no such file or folder: {path}")
    if not found:
        raise ResultFileError(
            f"nothing to report in {', '.join(map(str, paths))}: no {METRICS}, result, planner, policy, mp4 or figures"
        )

    def of(kind: str) -> list[Path]:
        return [file for file, found_kind in found.values() if found_kind == kind]

    return Sources(
        runs=tuple(read_run(file.parent) for file in of("run")),
        records=_distinct(record for file in of("transfer") for record in read_results(file)),
        videos=tuple(of("video")),
        figures=tuple(of("figure")),
        planners=tuple(of("planner")),
        policies=tuple(of("policy")),
        evaluations=tuple(read_evaluation(file) for file in of("evaluation")),
        files=tuple(file for place, (file, kind) in found.items() if kind != "figure" or place in named),
    )


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


def _kind(file: Path) -> str | None:
    """The kind of a file; None if a report cannot show it."""
    if file.name == METRICS:
        return "run"
    if file.suffix == _WEIGHTS:
        return "policy" if _is_policy(file) else "planner"
    if file.suffix == ".json":
        content = _content(file)
        if is_transfer(content) or is_matrix(content):
            return "transfer"
        return "evaluation" if is_evaluation(content) else None
    return _KINDS.get(file.suffix)


def _kind_of_named(file: Path) -> str:
    kind = _kind(file)
    if kind is None and file.suffix != ".json":
        raise ResultFileError(
            f"cannot report on {file}: give a run folder, {METRICS}, a result of `transfer` or `evaluate` (.json), a "
            "planner or policy (.safetensors), a video (.mp4) or a picture"
        )
    return kind or "transfer"  # whose reader says what is wrong


def _shown(file: Path, kind: str) -> bool:
    """Whether a file counts that is not named outright: no stray picture, and no policy before the last of its run."""
    if kind == "figure":
        return file.parent.name == _FIGURES
    run = file.parent.parent
    if file.suffix != _WEIGHTS or file.parent.name != _POLICIES or not (run / METRICS).exists():
        return True
    last = max(other.name for other in file.parent.glob(f"*{_WEIGHTS}"))
    return not (run / POLICY_FILE).exists() and file.name == last


def _is_policy(file: Path) -> bool:
    """Whether the header says so; the planner's loader reports a file that cannot be read."""
    try:
        with safe_open(file, framework="numpy") as opened:
            return json.loads((opened.metadata() or {})["ocplanner"])["kind"] == "policy"
    except (SafetensorError, OSError, KeyError, TypeError, ValueError):
        return False


def _content(file: Path) -> Any:
    """Parsed JSON; None if it cannot be read."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
