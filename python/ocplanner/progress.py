"""Progress on standard error or a console: bars on a terminal, and a line now and then elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

QUIET_SECONDS = 20.0
"""How long to stay silent where there is no terminal."""


class PlainLines:
    """Lines in place of a bar where there is no terminal."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._said = time.monotonic()

    def say(self, line: str) -> None:
        """Print a line."""
        self._said = time.monotonic()
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def say_if_quiet(self, line: Callable[[], str]) -> None:
        """Print a line, unless there is a terminal or something was printed recently."""
        if not self._console.is_terminal and time.monotonic() - self._said >= QUIET_SECONDS:
            self.say(line())


def counting_columns(unit: str = "") -> tuple[ProgressColumn, ...]:
    """The task, a bar, how many of how many are done, the time taken and the time left.

    Args:
        unit: what is counted; may refer to fields of the task as in rich.
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
    """A bar over demonstrations with steps per second; yields a function of each one's name and number of steps.

    The bar appears with the first demonstration, so that an earlier error leaves no bar behind.
    """
    bar = Progress(*counting_columns("demonstrations, {task.fields[rate]} steps/s"), console=console)
    line, steps, lines = bar.add_task(doing, total=total, rate="-"), 0, PlainLines(console)

    def advance(_: str, length: int) -> None:
        nonlocal steps
        bar.start()
        steps += length
        elapsed = bar.tasks[line].elapsed or 0.0
        bar.update(line, advance=1, rate=f"{steps / elapsed:.0f}" if elapsed > 1 else "-")
        lines.say_if_quiet(lambda: f"{doing}: {bar.tasks[line].completed:.0f} of {total} demonstrations")

    try:
        yield advance
    finally:
        bar.stop()


class TrainingProgress:
    """What a training reports on standard error.

    Args:
        shown: whether to report at all; of several processes only the first does.
    """

    def __init__(self, *, shown: bool = True) -> None:
        self._console = Console(stderr=True, quiet=not shown)
        self._lines = PlainLines(self._console)

    def say(self, line: str) -> None:
        """Print a line; a bar stays below it."""
        self._lines.say(line)

    @contextmanager
    def bar(self, name: str, total: int, done: int) -> Iterator[Callable[[float], None]]:
        """A bar for one stage of training; yields a function to call with the loss after each step."""
        columns = (
            TextColumn("{task.description:>10}"),
            BarColumn(),
            MofNCompleteColumn(),
            _StepsPerSecond(),
            TimeRemainingColumn(),
            TextColumn("loss {task.fields[loss]:.4g}"),
        )
        started, first = time.monotonic(), done
        with Progress(*columns, console=self._console, disable=not self._console.is_terminal) as bar:
            task = bar.add_task(name, total=total, completed=done, loss=float("nan"))

            def advance(loss: float) -> None:
                nonlocal done
                done += 1
                bar.update(task, advance=1, loss=loss)
                self._lines.say_if_quiet(lambda: self._line(name, total, done, loss, done - first, started))

            yield advance

    def _line(self, name: str, total: int, done: int, loss: float, steps: int, started: float) -> str:
        speed = steps / (time.monotonic() - started)
        return (
            f"{name}: step {done} of {total}, loss {loss:.4g}, {speed:.1f} steps/s, "
            f"{(total - done) / speed / 60:.1f} minutes left"
        )


class _StepsPerSecond(ProgressColumn):
    def render(self, task: Task) -> Text:
        """Steps per second."""
        return Text("" if task.speed is None else f"{task.speed:.1f} steps/s")
