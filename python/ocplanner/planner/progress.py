"""Progress of a training: a bar with speed and time left on a terminal, plain lines elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.text import Text

_QUIET_SECONDS = 20.0


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        """Steps a second."""
        return Text("" if task.speed is None else f"{task.speed:.1f} steps/s")


class Progress:
    """Writes to standard error."""

    def __init__(self) -> None:
        self.console = Console(stderr=True, highlight=False)
        self._said = time.monotonic()

    def say(self, line: str) -> None:
        """Print a line, above the bar when there is one."""
        self._said = time.monotonic()
        self.console.print(line, markup=False, soft_wrap=True)

    @contextmanager
    def bar(self, name: str, total: int, done: int) -> Iterator[Callable[[float], None]]:
        """A bar for one stage; call what it yields once a step with the loss."""
        if not self.console.is_terminal:
            yield self._lines(name, total, done)
            return
        columns = (
            TextColumn("{task.description:>10}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Rate(),
            TimeRemainingColumn(),
            TextColumn("loss {task.fields[loss]:.4g}"),
        )
        with RichProgress(*columns, console=self.console) as bar:
            task = bar.add_task(name, total=total, completed=done, loss=float("nan"))
            yield lambda loss: bar.update(task, advance=1, loss=loss)

    def _lines(self, name: str, total: int, done: int) -> Callable[[float], None]:
        """Where there is no bar: a line whenever nothing else has been said for a while."""
        started, first = time.monotonic(), done

        def step(loss: float) -> None:
            nonlocal done
            done += 1
            now = time.monotonic()
            if name and now - self._said > _QUIET_SECONDS:
                speed = (done - first) / (now - started)
                left = (total - done) / speed / 60
                where = f"{name}: step {done} of {total}, loss {loss:.4g}"
                self.say(f"{where}, {speed:.1f} steps/s, {left:.1f} minutes left")

        return step
