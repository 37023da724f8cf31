"""Read what training left in a run folder: ``config.yaml`` and ``metrics.jsonl``."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ocplanner.errors import ResultFileError

METRICS = "metrics.jsonl"
CONFIG = "config.yaml"
_DISTINGUISHING = ("task", "horizon", "outputs", "observe", "encoder", "seed")


@dataclass(frozen=True)
class Run:
    """One training run.

    Attributes:
        folder: where it lives.
        config: the resolved configuration, empty if there is none.
        rows: the lines of ``metrics.jsonl`` in order of writing.
    """

    folder: Path
    config: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name

    def stages(self) -> list[str]:
        """The stages that have been trained, in order."""
        return list(dict.fromkeys(str(row["stage"]) for row in self.rows))

    def series(self, stage: str, split: str, value: str) -> tuple[np.ndarray, np.ndarray]:
        """Steps (n,) and finite values (n,) of one curve; a repeated step (a resumed run) keeps the last value."""
        points = {
            int(row["step"]): float(row[value])
            for row in self.rows
            if row["stage"] == stage and row["split"] == split and isinstance(row.get(value), int | float)
        }
        finite = sorted((step, point) for step, point in points.items() if np.isfinite(point))
        return np.array([step for step, _ in finite]), np.array([point for _, point in finite])

    def last(self, value: str, split: str = "valid") -> float | None:
        """The value of the last row of ``split`` that has it, of whichever stage came last."""
        for row in reversed(self.rows):
            if row["split"] == split and isinstance(row.get(value), int | float):
                return float(row[value])
        return None

    def last_of(self, stage: str, value: str, split: str = "valid") -> float | None:
        """The last value of one curve."""
        _, values = self.series(stage, split, value)
        return float(values[-1]) if len(values) else None


def read_run(folder: str | Path) -> Run:
    """Read the run in ``folder``. A last line cut short by a kill is left out.

    Raises:
        ResultFileError: there is no ``metrics.jsonl``, or it or ``config.yaml`` is damaged.
    """
    folder = Path(folder)
    return Run(folder, _read_config(folder / CONFIG), _read_metrics(folder / METRICS))


def _read_config(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    try:
        config = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ResultFileError(f"cannot read {path}: {error}") from error
    if not isinstance(config, dict):
        raise ResultFileError(f"{path} holds no configuration: expected a mapping, found {type(config).__name__}")
    return config


def _read_metrics(path: Path) -> list[dict[str, Any]]:
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ResultFileError(f"cannot read {path}: {error}") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            if not {"step", "stage", "split"} <= row.keys():
                raise ValueError("a key is missing")
        except (ValueError, AttributeError) as error:
            if number == len(lines):
                break
            raise ResultFileError(
                f"line {number} of {path} is damaged: expected an object with step, stage and split"
            ) from error
        rows.append(row)
    return rows


def run_labels(runs: Iterable[Run]) -> list[str]:
    """A short label for each run that says in what the runs differ, such as ``H = 20, pose``."""
    runs = list(runs)
    described = [{key: _setting(run.config, key) for key in _DISTINGUISHING} for run in runs]
    differing = [key for key in _DISTINGUISHING if len({settings[key] for settings in described}) > 1]
    labels = []
    for run, settings in zip(runs, described):
        parts = [_spoken(key, settings[key]) for key in differing if settings[key]]
        labels.append(", ".join(parts) or run.name)
    if len(set(labels)) < len(labels):
        labels = [f"{label} ({run.name})" if label != run.name else label for label, run in zip(labels, runs)]
    return labels


def _setting(config: Mapping[str, Any], key: str) -> str:
    value = config.get(key, "")
    if isinstance(value, Mapping):
        value = value.get("type", "")
    return str(value)


def _spoken(key: str, value: str) -> str:
    return {"horizon": f"H = {value}", "seed": f"seed {value}"}.get(key, value)
