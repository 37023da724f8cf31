"""Success against the error of the object's pose."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from ocplanner.drawing.style import SERIES, new_figure, save_figure, styled
from ocplanner.errors import ResultFileError
from ocplanner.zero_shot.result import TransferResult, read_results

_APART = 0.12
"""Between lines at the same position noise, millimetres, so that their intervals do not cover each other."""


def noise_series(records: Iterable[TransferResult]) -> list[list[TransferResult]]:
    """Transfers that differ only in the noise of the pose and in its filter; lists with one noise are left out."""
    series: dict[tuple[Any, ...], list[TransferResult]] = {}
    for record in records:
        key = (*_without_noise(record).conditions, record.planner_sha256)
        series.setdefault(key, []).append(record)
    ordered = (sorted(members, key=lambda record: record.settings.pose_noise) for members in series.values())
    return [members for members in ordered if len({record.settings.pose_noise for record in members}) > 1]


def _without_noise(record: TransferResult) -> TransferResult:
    return replace(record, settings=replace(record.settings, pose_noise=(0.0, 0.0), pose_filter=1))


def success_against_noise(records: Sequence[TransferResult]) -> Figure:
    """Success rate against position noise with 95 % Wilson intervals, a line for each rotation noise and filter.

    Args:
        records: one of :func:`noise_series`.
    """
    lines: dict[tuple[int, float], list[TransferResult]] = {}
    for record in records:
        lines.setdefault((-record.settings.pose_filter, record.settings.pose_noise[1]), []).append(record)
    with styled():
        figure = new_figure(5.2, 3.4)
        axes = figure.subplots()
        for i, ((filtered, angle), line) in enumerate(sorted(lines.items())):
            rates = np.array([record.rate for record in line])
            margins = abs(np.array([record.interval for record in line]).T - rates)
            millimetres = [record.settings.pose_noise[0] + _APART * (i - (len(lines) - 1) / 2) for record in line]
            axes.errorbar(
                millimetres,
                rates,
                yerr=margins,
                marker="o",
                markersize=4.5,
                capsize=2.5,
                color=SERIES[i % len(SERIES)],
                linestyle="-" if filtered < -1 else "--",
                label=f"rotation noise {angle:g}°, " + (f"mean of {-filtered} steps" if filtered < -1 else "as read"),
            )
        axes.set(
            title=_without_noise(records[0]).title,
            xlabel="position noise, mm (standard deviation along each axis)",
            ylabel="success rate",
            ylim=(-0.02, 1.02),
        )
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def write_noise_plot(results: Iterable[Path], picture: Path) -> Path:
    """Draw result files of one transfer under several pose errors.

    Raises:
        ResultFileError: a file is damaged, or they are not such results.
        OutputError: the picture cannot be written.
    """
    series = noise_series(record for path in results for record in read_results(path))
    if len(series) != 1:
        raise ResultFileError(f"{len(series)} transfers under several pose errors were found; expected one")
    return save_figure(success_against_noise(series[0]), picture)
