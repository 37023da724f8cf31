"""A training's run folder: ``config.yaml`` says what was asked for, ``metrics.jsonl`` what was measured."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ocplanner.errors import ResultFileError
from ocplanner.files.storage import atomic_write, writing

CONFIG = "config.yaml"
METRICS = "metrics.jsonl"
POLICY_STAGE = "train"
"""The one stage of a policy's training."""
_FINAL = "final"


@dataclass(frozen=True)
class RunConfig:
    """The content of ``config.yaml``.

    Attributes:
        settings: the training's settings as plain values: a :class:`ocplanner.planner.config.PlannerTraining` or a
            :class:`ocplanner.policies.config.PolicyTraining`.
        data: digests of what the training reads; None if the file does not say.
    """

    settings: Mapping[str, Any]
    data: Any = None

    def to_yaml(self) -> dict[str, Any]:
        """The content of the file."""
        return {**self.settings, "data": self.data}


@dataclass(frozen=True)
class StepMetrics:
    """A line written while a stage trains.

    Attributes:
        stage: ``vae``, ``predictor`` or ``finetune`` of a planner, :data:`POLICY_STAGE` of a policy.
        step: training steps done.
        values: numbers by name, such as ``seconds``, ``loss``, ``valid_loss`` and ``ade_mm``.
    """

    stage: str
    step: int
    values: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """The content of the line."""
        return {"stage": self.stage, "step": self.step, **self.values}


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of a planner on held-out demonstrations, a line written when its training ends.

    Attributes:
        values: by name, such as ``ade_mm``, ``fde_mm`` and ``rotation_deg``; see
            :class:`ocplanner.planner.metrics.PlanErrors`.
        candidate: the stage whose weights they belong to: ``predictor`` or ``finetune``.
        kept: whether these weights became the planner.
        appearance: whose body hides the scene: ``source``, or the arm whose silhouette was painted in.
    """

    values: Mapping[str, float]
    candidate: str = ""
    kept: bool = False
    appearance: str = "source"

    def to_json(self) -> dict[str, Any]:
        """The content of the line."""
        facts = {key: value for key, value in asdict(self).items() if key != "values"}
        return {"stage": _FINAL, **facts, **self.values}


MetricsRow = StepMetrics | HeldOutErrors


def read_config(path: Path) -> RunConfig:
    """Read a run folder's ``config.yaml``.

    Raises:
        ResultFileError: the file cannot be read, or is no mapping.
    """
    import yaml  # not where a robot only plans

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"it holds no settings but {type(content).__name__}")
    except (OSError, ValueError, yaml.YAMLError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ResultFileError(f"{path} is damaged ({reason}); remove the run folder, or choose another") from error
    return RunConfig({key: value for key, value in content.items() if key != "data"}, content.get("data"))


def write_config(path: Path, config: RunConfig) -> None:
    """Write a run folder's ``config.yaml``; the file appears whole or not at all.

    Raises:
        OutputError: the folder cannot be written.
    """
    import yaml

    with atomic_write(path) as temporary:
        temporary.write_text(yaml.safe_dump(config.to_yaml(), sort_keys=False), encoding="utf-8")


def read_metrics(path: Path) -> list[MetricsRow]:
    """Read the lines of a ``metrics.jsonl`` in order of writing; a last line cut short by a kill is left out.

    Raises:
        ResultFileError: the file cannot be read, or another line is damaged.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ResultFileError(f"cannot read {path} ({error}); give the run folder of a training") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(_row(json.loads(line)))
        except (ValueError, TypeError, KeyError) as error:
            if number == len(lines):
                break
            raise ResultFileError(
                f"line {number} of {path} is damaged ({error!r}): expected a JSON object with a stage and a step; "
                "remove the line, or the run folder"
            ) from error
    return rows


def _row(content: Any) -> MetricsRow:
    if not isinstance(content, dict):
        raise TypeError(f"found {type(content).__name__}")
    values = {
        key: value for key, value in content.items() if isinstance(value, int | float) and key not in ("step", "kept")
    }
    if content["stage"] == _FINAL:
        facts = {key: content[key] for key in ("candidate", "kept", "appearance") if key in content}
        return HeldOutErrors(values, **facts)
    return StepMetrics(str(content["stage"]), int(content["step"]), values)


def append_metrics(path: Path, row: MetricsRow) -> None:
    """Add a line to a ``metrics.jsonl``.

    Raises:
        OutputError: the file cannot be written.
    """
    with writing(path), path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row.to_json()) + "\n")


def write_metrics(path: Path, rows: Iterable[MetricsRow]) -> None:
    """Replace the lines of a ``metrics.jsonl``; the file appears whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        temporary.write_text("".join(json.dumps(row.to_json()) + "\n" for row in rows), encoding="utf-8")
