"""Progress of a training: a bar with speed and time left on a terminal, plain lines elsewhere."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress
from rich.text import Text


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        """Steps a second."""
        return Text("" if task.speed is None else f"{task.speed:.1f} steps/s")


class Progress:
    """Writes to standard error."""

    def __init__(self) -> None:
        self.console = Console(stderr=True, highlight=False)

    def say(self, line: str) -> None:
        """Print a line, above the bar when there is one."""
        self.console.print(line, markup=False, soft_wrap=True)

    @contextmanager
    def bar(self, name: str, total: int, done: int) -> Iterator[Callable[[float], None]]:
        """A bar for one stage; call what it yields once a step with the loss."""
        if not self.console.is_terminal:
            yield lambda _loss: None
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
