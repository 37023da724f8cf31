"""The kept steps of single demonstrations, beside the object's height and the gripper."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.drawing.style import GRID, INK, MUTED, SERIES, new_figure, styled
from ocplanner.errors import InvalidValueError

_HEIGHT, _KEPT, _CLOSED = SERIES[0], SERIES[2], SERIES[1]


def segment_figure(demos: Demonstrations, names: Sequence[str], object_name: str | None = None) -> Figure:
    """One panel for each demonstration: the object's height, the closed gripper, and the steps that training keeps.

    Args:
        demos: a data set with object poses.
        names: the demonstrations to draw.
        object_name: the manipulated object, or one arm's part in carrying it; the task's first object if None.

    Raises:
        InvalidValueError: no demonstration was named.
        DatasetError: a demonstration is not there, or holds no manipulation.
    """
    if not names:
        raise InvalidValueError("no demonstration named; name at least one to draw")
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    with styled():
        figure = new_figure(7.4, 0.6 + 1.35 * rows)
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        for axes, name in zip(grid.flat, names):
            _panel(axes, demos[name], object_name or demos[name].object_names[0])
        for axes in grid.flat[len(names) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("height, m")
        for axes in grid.flat[max(0, len(names) - columns) : len(names)]:
            axes.set_xlabel("control step")
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _panel(axes: Axes, demo: Demonstration, object_name: str) -> None:
    positions, _ = demo.object_poses(object_name)
    gripper = demo.carrier_actions(object_name)
    segment = demo.manipulation(object_name)
    steps = np.arange(len(positions))
    axes.fill_between(
        steps,
        0,
        1,
        where=np.isin(steps, segment.rows).tolist(),
        transform=axes.get_xaxis_transform(),
        color=_KEPT,
        alpha=0.18,
        linewidth=0,
        step="mid",
        label="kept",
    )
    axes.plot(steps, positions[:, 2], color=_HEIGHT, label=f"height of {object_name}")
    axes.fill_between(
        steps,
        0,
        0.05,
        where=list(gripper > 0),
        transform=axes.get_xaxis_transform(),
        color=_CLOSED,
        linewidth=0,
        step="post",
        label="gripper closed",
    )
    marks = ((segment.onset, "o", "it moves"), (segment.release, "s", "released"))
    for step, marker, label in marks:
        axes.plot(step, positions[step, 2], marker, color=INK, markersize=4.5, markerfacecolor="white", label=label)
    axes.axvspan(0, segment.start, color=GRID, alpha=0.25, linewidth=0)
    axes.axvspan(segment.stop - 1, len(steps) - 1, color=GRID, alpha=0.25, linewidth=0)
    axes.set_xlim(0, len(steps) - 1)
    axes.set_title(demo.name)
    axes.set_title(f"{segment.length} of {len(steps)} steps", loc="right", fontsize=8, fontweight="normal", color=MUTED)
