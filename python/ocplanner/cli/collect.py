"""``ocplanner collect``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.collection.settings import CollectSettings
from ocplanner.progress import PlainLines, counting_columns
from ocplanner.rollouts.settings import WorkerSettings


@dataclass(frozen=True)
class Collect:
    """Record scripted demonstrations as a robomimic data set without images.

    You can stop it at any time; the same command continues where it stopped.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Data set to make (.hdf5)."""
    settings: Annotated[CollectSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=CollectSettings)
    workers: Annotated[WorkerSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=WorkerSettings)
    overwrite: bool = False
    """Replace the data set if it exists."""

    def run(self) -> None:
        """Collect with a progress bar."""
        from ocplanner.collection.collect import collect

        settings, console = self.settings, Console()
        doing = f"{settings.task}, {settings.robot}"
        with Progress(*counting_columns(), console=console, disable=not console.is_terminal) as progress:
            bar = progress.add_task(doing, total=settings.episodes)
            failed, lines = 0, PlainLines(console)

            def count(_: str, success: bool) -> None:
                nonlocal failed
                failed += not success
                text = doing + (f", {failed} failed" if failed else "")
                progress.update(bar, advance=int(success), description=text)
                lines.say_if_quiet(
                    lambda: f"{text}: {progress.tasks[bar].completed:.0f} of {settings.episodes} demonstrations"
                )

            collected = collect(self.out, settings, self.workers, overwrite=self.overwrite, progress=count)
        kept, left_out = ("demonstrations", "failed") if settings.flaw is None else ("failures", "successful")
        console.print(
            f"{collected.path}: {collected.demonstrations} {kept}; {collected.failures} {left_out} attempts left out",
            soft_wrap=True,
        )


COMMAND = Collect
