"""Curves of policies: training, and success while they learn."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ocplanner.drawing.style import SERIES, new_figure, styled
from ocplanner.errors import InvalidValueError
from ocplanner.files.records.metrics import POLICY_STAGE
from ocplanner.report.plots import run_curves, shared_legend, step_axis
from ocplanner.report.policy_results import PolicyCell
from ocplanner.report.runs import TrainingRun

_PANEL_HEIGHT = 2.9
TRAINING_VALUES = (
    ("loss", "training loss"),
    ("valid_loss", "held-out loss"),
    ("steps_per_second", "steps a second"),
)
"""Losses are mean negative log-likelihoods, which fall below zero."""


def policy_curves(runs: Sequence[TrainingRun]) -> Figure:
    """Loss on recorded actions, in training and held out, and speed, one line a policy's run."""
    with styled():
        figure = new_figure(7.4, 2.6)
        for axes, (value, title) in zip(figure.subplots(1, len(TRAINING_VALUES)), TRAINING_VALUES):
            run_curves(axes, runs, POLICY_STAGE, value, title)
        shared_legend(figure)
    return figure


def success_curves(cells: Sequence[PolicyCell]) -> Figure:
    """Success rate against training step: one panel an algorithm and kind of observation, one line a cell.

    The line is the mean rate over training seeds, the band (the bar, for a single checkpoint) its 95 % interval, see
    :meth:`ocplanner.report.policy_results.PolicyCell.curve`; thin lines are single seeds. A line has the steps at which
    every seed was evaluated.

    Raises:
        InvalidValueError: there is no cell.
    """
    if not cells:
        raise InvalidValueError("no evaluation to draw; give at least one")
    panels: dict[tuple[str, str], list[PolicyCell]] = {}
    for cell in cells:
        panels.setdefault((cell.kind.algorithm, cell.kind.observations), []).append(cell)
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    with styled():
        figure = new_figure(7.4 if columns > 1 else 5.2, _PANEL_HEIGHT * rows)
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        for axes, ((algorithm, observations), members) in zip(grid.flat, panels.items()):
            for i, cell in enumerate(members):
                _curve(axes, cell, SERIES[i % len(SERIES)])
            axes.set_title(f"{algorithm}, {observations}")
            axes.set_ylim(0, 1)
            axes.yaxis.set_major_formatter(PercentFormatter(1.0))
            step_axis(axes)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize="small")
        for axes in grid[:, 0]:
            axes.set_ylabel("success rate")
    return figure


def _curve(axes: Axes, cell: PolicyCell, color: str) -> None:
    steps, rates, intervals = cell.curve()
    seeds = len(cell.records)
    label = cell.variant + (f", {seeds} seeds" if seeds > 1 else "")
    if len(steps) == 1:
        axes.vlines(steps, *intervals.T, color=color, linewidth=1.4)
    else:
        axes.fill_between(steps, *intervals.T, color=color, alpha=0.15, linewidth=0)
    axes.plot(steps, rates, "o-", color=color, markersize=3.5, label=label)
    for record in cell.records if seeds > 1 else ():
        found = record.result.checkpoints
        axes.plot([one.step for one in found], [one.rate for one in found], color=color, linewidth=0.7, alpha=0.6)
