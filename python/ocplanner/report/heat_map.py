"""Success of every task on every robot as a heat map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ocplanner.drawing.style import GRID, INK, MUTED, SERIES, new_figure, save_figure, styled
from ocplanner.report.results import TransferGroup, group_results
from ocplanner.zero_shot.result import read_results

_SHADES = LinearSegmentedColormap.from_list("rates", ["#ffffff", SERIES[0]])
_LIGHT_TEXT = 0.6


@dataclass(frozen=True)
class HeatMap:
    """Results by task and robot.

    Attributes:
        rows: tasks, with how they were run where that differs.
        robots: one a column.
        cells: (row, robot) -> results of the cell; a cell that was not run is absent.
    """

    rows: tuple[str, ...]
    robots: tuple[str, ...]
    cells: Mapping[tuple[str, str], TransferGroup]

    @property
    def compares(self) -> bool:
        """Whether there is more than one robot to compare."""
        return len(self.robots) > 1


def heat_map(groups: Sequence[TransferGroup]) -> HeatMap:
    """Arrange groups by task and robot, in the order in which they first appear.

    Rows name the conditions where these differ, so that no two groups share a cell.
    """
    several = len({group.records[0].setting for group in groups}) > 1
    cells: dict[tuple[str, str], TransferGroup] = {}
    for group in groups:
        record = group.records[0]
        row = f"{record.task} ({record.setting})" if several else record.task
        if (row, record.robot) in cells:  # of versions whose patches differ
            row += f", patches: {', '.join(record.patches) or 'none'}"
        cells[row, record.robot] = group
    rows, robots = (tuple(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))
    return HeatMap(rows, robots, cells)


def cell_text(group: TransferGroup) -> tuple[str, str]:
    """The text of a cell: the count, or the mean rate of several planners, and the 95 % interval."""
    record, (low, high) = group.records[0], group.interval
    interval = f"{100 * low:.0f}-{100 * high:.0f} %"
    if len(group.records) > 1:
        return f"{100 * group.mean_rate:.0f} %", f"{interval}, {len(group.records)} planners"
    return f"{record.successes}/{record.episodes}", interval


def draw_heat_map(table: HeatMap) -> Figure:
    """The heat map as a figure: darker is better, an empty cell was not run."""
    with styled():
        figure = new_figure(1.6 + 0.95 * len(table.robots), 0.75 + 0.62 * len(table.rows))
        axes = figure.subplots()
        for row, name in enumerate(table.rows):
            for column, robot in enumerate(table.robots):
                group = table.cells.get((name, robot))
                face = "none" if group is None else _SHADES(0.9 * group.mean_rate)
                axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, facecolor=face, edgecolor=GRID))
                if group is None:
                    axes.text(column, row, "not run", ha="center", va="center", fontsize=7, color=MUTED)
                    continue
                ink = "white" if group.mean_rate > _LIGHT_TEXT else INK
                count, interval = cell_text(group)
                axes.text(column, row - 0.12, count, ha="center", va="center", weight="bold", color=ink)
                below = interval.replace(", ", "\n")
                axes.text(column, row + 0.24, below, ha="center", va="center", fontsize=7, color=ink)
        axes.set(xlim=(-0.5, len(table.robots) - 0.5), ylim=(len(table.rows) - 0.5, -0.5))
        axes.set_xticks(range(len(table.robots)), table.robots)
        axes.set_yticks(range(len(table.rows)), table.rows)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        axes.set_xlabel("successes of episodes, with 95 % intervals", fontsize=8, color=MUTED)
    return figure


def write_heat_map(results: Path, picture: Path) -> Path:
    """Draw a ``matrix.json``.

    Raises:
        ResultFileError: it is missing or damaged.
        OutputError: the picture cannot be written.
    """
    return save_figure(draw_heat_map(heat_map(group_results(read_results(results)))), picture)
