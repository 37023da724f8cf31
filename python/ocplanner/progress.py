"""The columns of a progress bar that counts towards a known total."""

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


def counting_columns(unit: str = "") -> tuple[ProgressColumn, ...]:
    """What is being done, a bar, how many of how many, the time it took and the time left.

    Args:
        unit: what is counted, said after the numbers; may refer to the task's fields as rich does.
    """
    return (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        *([TextColumn(unit)] if unit else []),
        TextColumn("elapsed"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
