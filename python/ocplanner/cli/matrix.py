"""``ocplanner matrix``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

from ocplanner.cli.transfer import EpisodeBar
from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError
from ocplanner.files.storage import check_output
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED, WorkerSettings
from ocplanner.zero_shot.settings import TransferConfig

if TYPE_CHECKING:
    from ocplanner.zero_shot.result import TransferResult

_PLANNERS = Path("results/planners")


@dataclass(frozen=True)
class Matrix:
    """Try the planner of every task on every robot, and draw the success rates as a heat map.

    You can stop it at any time; the same command continues where it stopped.
    """

    planners: tuple[Path, ...] = ()
    """Planner files, one for each task or each object of a task, or folders. Default: results/planners."""
    planner_seed: int = 0
    """From folders, take the planners of this training seed."""
    robots: tuple[str, ...] = tuple(ROBOTS)
    """The arms."""
    episodes: int = 50
    """Episodes of each task on each robot."""
    seed_start: int = FIRST_EVALUATION_SEED
    """Seed of the first episode; the others follow."""
    config: Annotated[TransferConfig, tyro.conf.OmitArgPrefixes] = field(default_factory=TransferConfig)
    workers: Annotated[WorkerSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=WorkerSettings)
    videos: int = 0
    """Record this many successes and this many failures of each task on each robot as mp4."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("results/matrix.json")
    """Result file; its cells are files in a folder of the same name. It keeps its cells of other tasks, robots and
    conditions."""
    overwrite: bool = False
    """Replace cells that hold other episodes, or those of another planner."""

    def run(self) -> None:
        """Run the cells with a progress bar."""
        from ocplanner.report.heat_map import write_heat_map
        from ocplanner.zero_shot.matrix import MatrixProgress, find_planners, transfer_matrix
        from ocplanner.zero_shot.transfer import seeds_of

        if not self.planners and not _PLANNERS.is_dir():
            raise InvalidValueError(
                f"there is no folder {_PLANNERS} here; name planner files with --planners, or run this in a clone of "
                "the repository"
            )
        planners = find_planners(self.planners or (_PLANNERS,), self.planner_seed)
        check_output(self.out, True, "JSON result", (path for each in planners for path in each.paths))
        picture, console = self.out.with_suffix(".png"), Console()
        check_output(picture, True, "picture")
        number, total = 0, len(planners) * len(dict.fromkeys(self.robots))
        with EpisodeBar(console) as bar:

            def begin(cell: "TransferResult") -> None:
                nonlocal number
                number += 1
                bar.begin(f"{cell.task} on {cell.robot} ({number} of {total})", self.episodes)

            def done(cell: "TransferResult") -> None:
                console.print(str(cell), soft_wrap=True)
                write_heat_map(self.out, picture)

            transfer_matrix(
                planners,
                self.robots,
                out=self.out,
                episodes=seeds_of(self.episodes, self.seed_start),
                config=self.config,
                workers=self.workers,
                overwrite=self.overwrite,
                videos=self.videos,
                progress=MatrixProgress(begin, bar.count, done),
            )
        console.print(f"{self.out}, {picture}", soft_wrap=True)


COMMAND = Matrix
