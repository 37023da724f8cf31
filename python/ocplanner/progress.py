"""Progress bars that count towards a known total."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
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


@contextmanager
def demonstrations_bar(doing: str, total: int, console: Console) -> Iterator[Callable[[str, int], None]]:
    """A bar over demonstrations with steps a second; yields what is called with the name and the steps of each.

    It appears with the first, so that an error before leaves none behind.
    """
    bar = Progress(*counting_columns("demonstrations, {task.fields[rate]} steps/s"), console=console)
    line, steps = bar.add_task(doing, total=total, rate="-"), 0

    def advance(_: str, length: int) -> None:
        nonlocal steps
        bar.start()
        steps += length
        elapsed = bar.tasks[line].elapsed or 0.0
        bar.update(line, advance=1, rate=f"{steps / elapsed:.0f}" if elapsed > 1 else "-")

    try:
        yield advance
    finally:
        bar.stop()
