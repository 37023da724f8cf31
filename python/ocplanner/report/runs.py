"""Read what training left in a run folder: ``config.yaml`` and ``metrics.jsonl``."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ocplanner.errors import ResultFileError
from ocplanner.report.policy_results import PolicyKind, policy_kind

METRICS = "metrics.jsonl"
CONFIG = "config.yaml"
POLICY_STAGE = "train"
_DISTINGUISHING = ("algorithm", "observations", "hint", "preset", "horizon", "outputs", "observe", "encoder", "seed")


@dataclass(frozen=True)
class HeldOut:
    """Errors on held-out demonstrations.

    Attributes:
        stage: the stage whose weights they are of: "predictor" or "finetune".
        appearance: whose body hides the scene: "source", or another arm's silhouette.
        kept: whether these weights became the planner.
        row: the values by name, such as ``ade_mm``, ``fde_mm`` and ``rotation_deg``.
    """

    stage: str
    appearance: str
    kept: bool
    row: Mapping[str, Any]


@dataclass(frozen=True)
class TrainingRun:
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

    @property
    def of_policy(self) -> bool:
        """Whether it trained a policy; otherwise it trained a planner."""
        return "algorithm" in self.config or any(row["stage"] == POLICY_STAGE for row in self.rows)

    @property
    def policy_kind(self) -> PolicyKind:
        """What policy it trained."""
        return policy_kind(self.config)

    def setting(self, key: str) -> str:
        """A setting as text, looked up at the top of the configuration and in its network; "" if absent.

        Of a policy ``algorithm``, ``observations`` and ``hint`` are given in words.
        """
        if self.of_policy and key in ("algorithm", "observations", "hint"):
            return getattr(self.policy_kind, "variant" if key == "hint" else key)
        value = self.config.get(key, (self.config.get("network") or {}).get(key, ""))
        return str(value.get("type", "") if isinstance(value, Mapping) else value)

    def series(self, stage: str, value: str) -> tuple[np.ndarray, np.ndarray]:
        """Steps (n,) and finite values (n,) of one curve; a repeated step (a resumed run) keeps the last value."""
        points = {
            int(row["step"]): float(row[value])
            for row in self.rows
            if row["stage"] == stage and "step" in row and isinstance(row.get(value), int | float)
        }
        finite = sorted((step, point) for step, point in points.items() if np.isfinite(point))
        return np.array([step for step, _ in finite]), np.array([point for _, point in finite])

    def held_out(self) -> list[HeldOut]:
        """The final errors; of a run that is not finished, the latest ones of each stage."""
        final = [row for row in self.rows if row["stage"] == "final"]
        if final:
            return [
                HeldOut(str(row.get("candidate", "")), str(row.get("appearance", "source")), bool(row.get("kept")), row)
                for row in final
            ]
        latest = {
            row["stage"]: row for row in self.rows if row["stage"] in ("predictor", "finetune") and "ade_mm" in row
        }
        return [HeldOut(stage, "source", False, row) for stage, row in latest.items()]


def read_run(folder: str | Path) -> TrainingRun:
    """Read the run in ``folder``. A last line cut short by a kill is left out.

    Raises:
        ResultFileError: there is no ``metrics.jsonl``, or it or ``config.yaml`` is damaged.
    """
    folder = Path(folder)
    run = TrainingRun(folder, _read_config(folder / CONFIG), _read_metrics(folder / METRICS))
    try:
        _ = run.setting("horizon"), run.policy_kind
    except (AttributeError, KeyError, TypeError) as error:
        raise ResultFileError(f"{folder / CONFIG} is no configuration of a training: {error!r}") from error
    return run


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
            if not isinstance(row, dict) or "stage" not in row:
                raise ValueError("no stage")
        except ValueError as error:
            if number == len(lines):
                break
            raise ResultFileError(f"line {number} of {path} is damaged: expected a JSON object with a stage") from error
        rows.append(row)
    return rows


def run_labels(runs: Iterable[TrainingRun]) -> list[str]:
    """A short label for each run that says in what the runs differ, such as ``H = 20, pose``."""
    runs = list(runs)
    differing = [key for key in _DISTINGUISHING if len({run.setting(key) for run in runs}) > 1]
    labels = []
    for run in runs:
        parts = [_spoken(key, run.setting(key)) for key in differing if run.setting(key)]
        labels.append(", ".join(parts) or run.name)
    if len(set(labels)) < len(labels):
        labels = [f"{label} ({run.name})" if label != run.name else label for label, run in zip(labels, runs)]
    return labels


def _spoken(key: str, value: str) -> str:
    return {"horizon": f"H = {value}", "seed": f"seed {value}"}.get(key, value)
