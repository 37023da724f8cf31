"""Run folders of trainings, for curves and tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ocplanner.errors import InvalidValueError, ResultFileError
from ocplanner.files.records.metrics import (
    CONFIG,
    METRICS,
    POLICY_STAGE,
    HeldOutErrors,
    MetricsRow,
    RunConfig,
    StepMetrics,
    read_config,
    read_metrics,
)
from ocplanner.planner.config import PlannerTraining
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.config import training_from_dict as policy_training
from ocplanner.report.policy_results import PolicyKind, policy_kind
from ocplanner.settings import build


@dataclass(frozen=True)
class TrainingRun:
    """One training.

    Attributes:
        folder: where it lives.
        config: the content of ``config.yaml``; no settings if there is no such file.
        settings: the same as settings; None if there is no such file.
        rows: the lines of ``metrics.jsonl`` in order of writing.
    """

    folder: Path
    config: RunConfig
    settings: PlannerTraining | PolicyTraining | None
    rows: Sequence[MetricsRow]

    @property
    def name(self) -> str:
        """The folder's name."""
        return self.folder.resolve().name

    @property
    def of_policy(self) -> bool:
        """Whether it trained a policy; otherwise it trained a planner."""
        return isinstance(self.settings, PolicyTraining) or any(row.stage == POLICY_STAGE for row in self._steps())

    @property
    def policy_kind(self) -> PolicyKind:
        """The kind of policy that it trained."""
        if isinstance(self.settings, PolicyTraining):
            return policy_kind(self.settings)
        return PolicyKind("UNKNOWN", "state", "")

    @property
    def facts(self) -> dict[str, str]:
        """The settings that tell runs apart, in words; none without a ``config.yaml``."""
        training = self.settings
        if training is None:
            return {}
        if isinstance(training, PolicyTraining):
            kind = self.policy_kind
            facts = {"algorithm": kind.algorithm, "observations": kind.observations, "hint": kind.variant}
            return {**facts, "preset": training.preset, "seed": f"seed {training.seed}"}
        network = training.network
        return {
            "preset": training.preset,
            "horizon": f"H = {network.horizon}",
            "outputs": network.outputs,
            "observe": training.observe,
            "encoder": network.encoder.type,
            "seed": f"seed {training.seed}",
        }

    def series(self, stage: str, value: str) -> tuple[np.ndarray, np.ndarray]:
        """Steps (n,) and finite values (n,) of one curve; a repeated step (a resumed run) keeps the last value."""
        points = {row.step: row.values[value] for row in self._steps() if row.stage == stage and value in row.values}
        finite = sorted((step, point) for step, point in points.items() if np.isfinite(point))
        return np.array([step for step, _ in finite]), np.array([point for _, point in finite])

    def held_out(self) -> list[HeldOutErrors]:
        """The final errors; of a run that is not finished, the latest ones of each stage that plans."""
        final = [row for row in self.rows if isinstance(row, HeldOutErrors)]
        latest = {row.stage: row.values for row in self._steps() if "ade_mm" in row.values and row.stage != "vae"}
        return final or [HeldOutErrors(values, stage) for stage, values in latest.items()]

    def _steps(self) -> list[StepMetrics]:
        return [row for row in self.rows if isinstance(row, StepMetrics)]


def read_run(folder: str | Path) -> TrainingRun:
    """Read the run in ``folder``.

    Raises:
        ResultFileError: there is no ``metrics.jsonl``, or it or ``config.yaml`` is damaged.
    """
    path = Path(folder) / CONFIG
    config = read_config(path) if path.exists() else RunConfig({})
    parse = policy_training if "algorithm" in config.settings else partial(build, PlannerTraining)
    try:
        settings = parse(config.settings) if path.exists() else None
    except (InvalidValueError, TypeError, AttributeError, ValueError) as error:
        raise ResultFileError(f"{path} holds no settings of a training ({error}); give another run folder") from error
    return TrainingRun(Path(folder), config, settings, read_metrics(Path(folder) / METRICS))


def run_labels(runs: Iterable[TrainingRun]) -> list[str]:
    """A short label for each run that says in what the runs differ, such as ``H = 20, pose``."""
    runs = list(runs)
    names = list(dict.fromkeys(name for run in runs for name in run.facts))
    differing = [name for name in names if len({run.facts.get(name) for run in runs}) > 1]
    labels = [", ".join(run.facts[name] for name in differing if name in run.facts) or run.name for run in runs]
    if len(set(labels)) < len(labels):
        labels = [f"{label} ({run.name})" if label != run.name else label for label, run in zip(labels, runs)]
    return labels
