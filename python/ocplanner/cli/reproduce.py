"""``ocplanner reproduce``: remake the measured results."""

import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from ocplanner.evaluation import encoders, experiments, held_out, reproduction
from ocplanner.evaluation.experiments import PlannerExperiment
from ocplanner.evaluation.marked_tables import write_tables


@dataclass(frozen=True)
class Reproduce:
    """Remake the files under ``results/``: planners trained on Square PH, their zero-shot transfers, and the tables.

    What is there already is not done again; run the same command again after a stop.
    """

    part: Annotated[Literal["planners", "zero-shot", "encoders", "tables"], tyro.conf.Positional]
    """planners: images, training and held-out errors. zero-shot: every planner on every arm. encoders: the search
    for the smallest image encoder. tables: rewrite those in README.md and results/README.md from the result files,
    which zero-shot and encoders do too."""
    data: Path = Path("square_ph.hdf5")
    """robomimic's Square PH low-dimensional data set."""
    work: Path = Path("runs/reproduce")
    """Images, run folders and logs."""
    results: Path = Path("results")
    """Result files and planner files."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Training seeds."""
    episodes: int = 100
    """Episodes of each transfer, seeds 10000 and up."""
    workers: int = 2
    """Processes."""
    channels: tuple[int, ...] = ()
    """planners: channels of the encoder's convolutions, if not the preset's; give also --work and --results."""
    again: bool = False
    """Train also the planners that the results hold already; runs that are finished in the work folder are taken."""

    def run(self) -> None:
        """Do what is missing, one line for each step done."""
        console = Console()
        parts = {"planners": self._planners, "zero-shot": self._zero_shot, "encoders": self._encoders}
        parts.get(self.part, self._tables)(console)

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
        command = shlex.join(["ocplanner", *sys.argv[1:]])
        for experiment in reproduction.train_all(missing, self.work, self.workers):
            out = held_out.write([experiment], wanted, self.work, self.results, command)
            reproduction.publish(experiment, self.work, self.results)  # last: a planner file says that its rows are new
            console.print(f"trained {experiment.name}; errors in {out}")

    def _zero_shot(self, console: Console) -> None:
        for experiment in experiments.transfer_experiments(self.seeds):
            name = reproduction.transfer(experiment, self.work, self.results, self.episodes, self.workers)
            write_tables(self.results)
            console.print(f"done {name}")

    def _encoders(self, console: Console) -> None:
        wanted = encoders.encoder_experiments(self.seeds)
        for name in reproduction.render_images([PlannerExperiment()], self.data, self.work, self.workers):
            console.print(f"rendered {name}")
        command = shlex.join(["ocplanner", *sys.argv[1:]])
        for experiment in encoders.train_encoders(wanted, self.work, self.workers):
            out = encoders.write(wanted, self.work, self.results, command)
            write_tables(self.results)
            console.print(f"trained {experiment.name}; errors in {out}")

    def _tables(self, console: Console) -> None:
        for path in write_tables(self.results):
            console.print(f"tables in {path}", soft_wrap=True)


COMMAND = Reproduce
