"""``ocplanner collect``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.collection.settings import Flaw
from ocplanner.progress import PlainLines, counting_columns


@dataclass(frozen=True)
class Collect:
    """Record scripted demonstrations as a robomimic data set without images.

    Stop it whenever you like: the same command goes on where it was.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Data set to make (.hdf5)."""
    task: str = "Square"
    """The task."""
    robot: str = "Panda"
    """The arm."""
    episodes: int = 100
    """Successful demonstrations to record (with --flaw: failures); other attempts are left out and counted."""
    flaw: Flaw | None = None
    """Record failures instead: the expert lets go on the way, or puts the object down beside its goal."""
    noise: float = 1.0
    """How far demonstrations differ in path and tremor: 1 about as people's, 0 not at all."""
    seed: int = 0
    """0 to 9: which thousand of attempts. Seeds from 10000 on are kept for evaluation."""
    workers: int = 1
    """Processes; the data set does not depend on it."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Run the workers on a Ray cluster: HOST:PORT, 'auto', or 'local' for one on this machine."""
    overwrite: bool = False
    """Replace the data set if it is there."""

    def run(self) -> None:
        """Collect with a progress bar."""
        from ocplanner.collection.collect import collect

        console = Console()
        with Progress(*counting_columns(), console=console, disable=not console.is_terminal) as progress:
            bar = progress.add_task(f"{self.task}, {self.robot}", total=self.episodes)
            failed, lines = 0, PlainLines(console)

            def count(_: str, success: bool) -> None:
                nonlocal failed
                failed += not success
                text = f"{self.task}, {self.robot}" + (f", {failed} failed" if failed else "")
                progress.update(bar, advance=int(success), description=text)
                lines.say(f"{text}: {progress.tasks[bar].completed:.0f} of {self.episodes} demonstrations")

            collected = collect(
                self.out,
                self.task,
                self.robot,
                episodes=self.episodes,
                seed=self.seed,
                flaw=self.flaw,
                noise=self.noise,
                workers=self.workers,
                ray=self.ray,
                overwrite=self.overwrite,
                progress=count,
            )
        console.print(
            f"{collected.path}: {collected.demonstrations} {'demonstrations' if self.flaw is None else 'failures'}; "
            f"{collected.failures} {'failed' if self.flaw is None else 'successful'} attempts left out",
            soft_wrap=True,
        )


COMMAND = Collect
