"""What the page says of policies: a table, success curves and training curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ocplanner.drawing.style import SERIES, page_svg
from ocplanner.files.records.metrics import POLICY_STAGE
from ocplanner.report.plots import curve_panel
from ocplanner.report.policy_curves import TRAINING_VALUES, success_curves
from ocplanner.report.policy_results import PolicyCell, PolicyKind, policy_cells
from ocplanner.report.runs import TrainingRun, run_labels
from ocplanner.report.sources import Sources


@dataclass(frozen=True)
class PolicyRow:
    """A line of the table; rates in percent as text, "" where nothing was evaluated.

    Attributes:
        kind: what the policies are.
        note: what sets them apart from others of the kind.
        seeds: the training seeds.
        best: of each training's checkpoints, mean and deviation over the seeds.
        last_five: the same of the mean of the last five.
        interval: percent, 95 % interval of ``last_five``, over trainings and episodes.
        episodes: of each checkpoint.
        checkpoints: evaluated, all seeds together.
    """

    kind: PolicyKind
    note: str
    seeds: tuple[int, ...]
    best: str = ""
    last_five: str = ""
    interval: tuple[float, float] = (0.0, 100.0)
    episodes: int = 0
    checkpoints: int = 0


@dataclass(frozen=True)
class PolicySection:
    """The section; empty rows and no panels if there are no policies."""

    rows: list[PolicyRow]
    success: Markup | None
    panels: list[Markup]
    legend: list[tuple[str, int]]


def policy_section(sources: Sources) -> PolicySection:
    """Gather what was found of policies."""
    cells = policy_cells(sources.evaluations)
    runs = sources.policy_runs
    evaluated = [record.training for record in sources.evaluations]
    alone = [run for run in runs if run.settings not in evaluated]
    return PolicySection(
        rows=[_row(cell) for cell in cells] + [_bare_row(run) for run in alone],
        success=Markup(page_svg(success_curves(cells), "success")) if cells else None,  # noqa: S704 escaped by matplotlib
        panels=_panels(runs),
        legend=[(label, i % len(SERIES)) for i, label in enumerate(run_labels(runs))] if len(runs) > 1 else [],
    )


def _row(cell: PolicyCell) -> PolicyRow:
    low, high = cell.interval
    return PolicyRow(
        kind=cell.kind,
        note=cell.note,
        seeds=tuple(record.seed for record in cell.records),
        best=_percent(cell.best),
        last_five=_percent(cell.last_five),
        interval=(100 * low, 100 * high),
        episodes=cell.records[0].result.settings.episodes,
        checkpoints=sum(len(record.result.checkpoints) for record in cell.records),
    )


def _bare_row(run: TrainingRun) -> PolicyRow:
    return PolicyRow(run.policy_kind, run.name, () if run.settings is None else (run.settings.seed,))


def _percent(rates: np.ndarray) -> str:
    mean, deviation = 100 * rates.mean(), 100 * rates.std()
    return f"{mean:.1f}" if len(rates) == 1 else f"{mean:.1f} ± {deviation:.1f}"


def _panels(runs: Sequence[TrainingRun]) -> list[Markup]:
    drawn = [
        (value, title)
        for value, title in TRAINING_VALUES
        if any(len(run.series(POLICY_STAGE, value)[0]) for run in runs)
    ]
    return [
        Markup(page_svg(curve_panel(runs, POLICY_STAGE, value, title), f"policy{i}"))  # noqa: S704 escaped by matplotlib
        for i, (value, title) in enumerate(drawn)
    ]
