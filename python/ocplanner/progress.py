"""Progress bars that count towards a known total."""

import time
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

QUIET_SECONDS = 20.0
"""How long nothing is said where there is no terminal."""


class PlainLines:
    """In place of a bar where there is no terminal: says how far it is when nothing was said for a while."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said = time.monotonic()

    def say(self, line: str) -> None:
        """Print the line, unless there is a terminal or the last one is recent."""
        if self._console.is_terminal or time.monotonic() - self._said < QUIET_SECONDS:
            return
        self._said = time.monotonic()
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


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
    line, steps, lines = bar.add_task(doing, total=total, rate="-"), 0, PlainLines(console)

    def advance(_: str, length: int) -> None:
        nonlocal steps
        bar.start()
        steps += length
        elapsed = bar.tasks[line].elapsed or 0.0
        bar.update(line, advance=1, rate=f"{steps / elapsed:.0f}" if elapsed > 1 else "-")
        lines.say(f"{doing}: {bar.tasks[line].completed:.0f} of {total} demonstrations")

    try:
        yield advance
    finally:
        bar.stop()
