"""``ocplanner reproduce``: remake the measured results."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from ocplanner.errors import InvalidValueError
from ocplanner.planner.config import Preset
from ocplanner.reproduction import encoders, experiments, held_out, policy_experiments, reproduction
from ocplanner.reproduction.experiments import PlannerExperiment
from ocplanner.reproduction.markdown_tables import write_tables
from ocplanner.reproduction.policy_tables import TABLES, PolicyTable
from ocplanner.settings import require_seed
from ocplanner.versions import running_command


@dataclass(frozen=True)
class Reproduce:
    """Remake the files under ``results/``: planners trained on Square PH, their zero-shot transfers, policies, tables;
    and the paper's figures.

    It skips files that exist. You can stop it at any time; the same command continues where it stopped.
    """

    part: Annotated[
        Literal["planners", "zero-shot", "matrix", "pose-noise", "encoders", "tables"] | None, tyro.conf.Positional
    ] = None
    """planners: images, training and held-out errors. zero-shot: every planner on every arm. matrix: every task on
    every arm. pose-noise: Square on Sawyer with imprecise object poses. encoders: the search for the smallest image
    encoder. tables: rewrite those in README.md and results/README.md from the result files, as the other parts do too.
    Leave it out with --table or --figure."""
    table: Literal[1, 2] | None = None
    """A table of the paper, its policies trained and evaluated. 1: with and without the plan as a hint. 2: BCQ with and
    without the plan's reward."""
    figure: Literal[4, 5, 6, 7, 8] | None = None
    """A figure of the paper, drawn with planners of the first seed; planners that the results lack are trained.
    4: validation losses for H = 5, 20 and 50. 5, 6: planned and true positions for H = 20, 50. 7: latent plans along
    10 demonstrations. 8: a zero-shot episode on Sawyer."""
    preset: Preset = "cpu"
    """Preset of the figures' planners; the results hold only those of the preset cpu."""
    device: str = "cpu"
    """torch device of the figures' trainings."""
    images: Path = Path("docs/images")
    """Folder of the figures."""
    data: Path = Path("square_ph.hdf5")
    """robomimic's Square PH low-dimensional data set."""
    work: Path = Path("runs/reproduce")
    """Folder of images, run folders and logs."""
    results: Path = Path("results")
    """Folder of result files and planner files."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds."""
    episodes: int = 100
    """Episodes of each transfer, from seed 10000 on; half as many for matrix and pose-noise. For policies, half as many
    for each checkpoint, from seed 20000 on."""
    workers: int = 2
    """Worker processes."""
    channels: tuple[int, ...] = ()
    """planners: channels of the encoder's convolutions, if not the preset's; give --work and --results, too."""
    again: bool = False
    """Train also the planners that the results already hold, except those whose run in the work folder is finished."""

    def run(self) -> None:
        """Run the missing steps and print a line for each."""
        if sum(asked is not None for asked in (self.part, self.table, self.figure)) != 1:
            raise InvalidValueError(
                "say what to remake: planners, zero-shot, matrix, pose-noise, encoders or tables, or --table 1 or 2, "
                "or --figure 4 to 8"
            )
        for seed in self.seeds:
            require_seed(seed, "seeds")
        console = Console()
        parts = {
            "planners": self._planners,
            "zero-shot": self._zero_shot,
            "matrix": self._matrix,
            "pose-noise": self._pose_noise,
            "encoders": self._encoders,
        }
        if self.table is not None:
            self._policies(console, TABLES[self.table])
        elif self.figure is not None:
            self._figure(console, self.figure)
        else:
            parts.get(str(self.part), self._only_tables)(console)

    def _planners(self, console: Console) -> None:
        wanted = [
            replace(experiment, channels=self.channels) for experiment in experiments.planner_experiments(self.seeds)
        ]
        missing = [experiment for experiment in wanted if self.again or not held_out.is_kept(experiment, self.results)]
        for experiment in wanted:
            if experiment not in missing:
                console.print(f"kept {experiment.name}")
        for name in reproduction.render_images(missing, self.data, self.work, self.workers):
            console.print(f"rendered {name}")
        for experiment in reproduction.train_all(missing, self.work, self.workers):
            out = held_out.write([experiment], wanted, self.work, self.results, running_command())
            reproduction.publish(experiment, self.work, self.results)  # last: a planner file means that its rows exist
            console.print(f"trained {experiment.name}; errors in {out}")

    def _zero_shot(self, console: Console) -> None:
        for experiment in experiments.transfer_experiments(self.seeds):
            planner = experiment.planner.file(self.results)
            if not planner.exists():
                console.print(
                    f"left out {experiment.name}: there is no {planner}, which `ocplanner reproduce planners` makes",
                    soft_wrap=True,
                )
                continue
            name = reproduction.transfer(experiment, self.work, self.results, self.episodes, self.workers)
            write_tables(self.results)
            console.print(f"done {name}")

    def _matrix(self, console: Console) -> None:
        from ocplanner.report.heat_map import write_heat_map

        out = reproduction.transfer_matrix(self.seeds[0], self.work, self.results, self.episodes // 2, self.workers)
        picture = write_heat_map(out, self.images / "matrix.png")
        write_tables(self.results)
        console.print(f"done {out}, {picture}", soft_wrap=True)

    def _pose_noise(self, console: Console) -> None:
        from ocplanner.report.noise_plot import write_noise_plot

        done: list[Path] = []
        for experiment in experiments.pose_noise_experiments(self.seeds[0]):
            name = reproduction.transfer(experiment, self.work, self.results, self.episodes // 2, self.workers)
            console.print(f"done {name}")
            done.append(self.results / f"{name}.json")
            if len(done) > 1:
                write_noise_plot(done, self.images / "pose_noise.png")
            write_tables(self.results)

    def _encoders(self, console: Console) -> None:
        wanted = encoders.encoder_experiments(self.seeds)
        for name in reproduction.render_images([PlannerExperiment()], self.data, self.work, self.workers):
            console.print(f"rendered {name}")
        for experiment in encoders.train_encoders(wanted, self.work, self.workers):
            out = encoders.write(wanted, self.work, self.results, running_command())
            write_tables(self.results)
            console.print(f"trained {experiment.name}; errors in {out}")

    def _policies(self, console: Console, table: PolicyTable) -> None:
        wanted = table.experiments(self.seeds)
        missing = policy_experiments.missing_results(wanted, self.results, self.episodes // 2)
        for name in policy_experiments.make_data(missing, self.data, self.work, self.results, self.workers):
            console.print(f"made {name}")
        for experiment in policy_experiments.run_all(
            missing, self.data, self.work, self.results, self.episodes // 2, self.workers
        ):
            table.write(wanted, self.results)
            console.print(f"done {experiment.name}")
        self._tables(console)

    def _figure(self, console: Console, number: int) -> None:
        from ocplanner.reproduction.paper_figures import FigureWork, draw

        work = FigureWork(
            self.data, self.work, self.results, self.preset, self.seeds[0], workers=self.workers, device=self.device
        )
        console.print(f"drew {draw(number, work, self.images)}", soft_wrap=True)

    def _only_tables(self, console: Console) -> None:
        if not self._tables(console):
            raise InvalidValueError(
                f"no page with tables belongs to {self.results}; run this in a clone of the repository, or name "
                "another folder of results with --results"
            )

    def _tables(self, console: Console) -> bool:
        """Whether there are any."""
        for table in TABLES.values():
            table.write(table.experiments(self.seeds), self.results)
        pages = write_tables(self.results)
        for path in pages:
            console.print(f"tables in {path}", soft_wrap=True)
        return len(pages) > 0


COMMAND = Reproduce
