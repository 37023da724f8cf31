"""``ocplanner transfer``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.progress import counting_columns
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED, WorkerSettings
from ocplanner.zero_shot.settings import TransferConfig

if TYPE_CHECKING:
    from ocplanner.files.records.episode import EpisodeResult


@dataclass(frozen=True)
class Transfer:
    """Solve a planner's task on a robot that never demonstrated it.

    You can stop it at any time; the same command continues where it stopped.
    """

    planner: tuple[Path, ...]
    """Planner file (.safetensors) or the run folder of its training; for a task with several objects, one for each."""
    robot: str = "Sawyer"
    """The arm, such as Panda, Sawyer or UR5e; an unknown name lists all of them."""
    episodes: int = 50
    """Episodes to run."""
    seed_start: int = FIRST_EVALUATION_SEED
    """Seed of the first episode; the others follow."""
    config: Annotated[TransferConfig, tyro.conf.OmitArgPrefixes] = field(default_factory=TransferConfig)
    workers: Annotated[WorkerSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=WorkerSettings)
    videos: int = 0
    """Record this many of the first episodes as mp4."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Result file. Default: results/transfer/TASK_ROBOT_FOLLOW_OBSERVE_SEED.json."""
    overwrite: bool = False
    """Replace the result file if it exists."""

    def run(self) -> None:
        """Transfer with a progress bar."""
        from ocplanner.zero_shot.setup import TransferSetup
        from ocplanner.zero_shot.transfer import run_transfer, seeds_of

        setup = TransferSetup.of(self.planner, self.robot, self.config)
        out = self.out or Path("results/transfer") / setup.result.file_name
        console = Console()
        with EpisodeBar(console) as bar:
            bar.begin(setup.result.robot, self.episodes)
            result = run_transfer(
                setup,
                seeds_of(self.episodes, self.seed_start),
                workers=self.workers,
                out=out,
                overwrite=self.overwrite,
                videos=self.videos,
                on_episode=bar.count,
            )
        console.print(str(result), soft_wrap=True)
        console.print(f"{out}", soft_wrap=True)


class EpisodeBar:
    """A bar that counts episodes and successes; without a terminal each episode is a line. A context manager."""

    def __init__(self, console: Console) -> None:
        self._console, self._name, self._successes = console, "", 0
        self._progress = Progress(*counting_columns(), console=console, disable=not console.is_terminal)
        self._bar = self._progress.add_task("")

    def __enter__(self) -> "EpisodeBar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, name: str, episodes: int) -> None:
        """Begin to count so many episodes."""
        self._name, self._successes = name, 0
        self._progress.reset(self._bar, total=episodes, description=name)

    def count(self, run: "EpisodeResult") -> None:
        """Count one episode."""
        self._successes += run.success
        self._progress.update(self._bar, advance=1, description=f"{self._name}: {self._successes} succeeded")
        if not self._console.is_terminal:
            ended = "success" if run.success else run.failure
            where = "" if run.failed_with is None else f" with the {run.failed_with}"
            self._console.print(f"seed {run.seed}: {ended}{where} ({run.steps} steps)")


COMMAND = Transfer
