"""``ocplanner reproduce``: remake the measured results."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from ocplanner.evaluation import reproduction


@dataclass(frozen=True)
class Reproduce:
    """Remake the files under ``results/``: planners trained on Square PH, and their zero-shot transfers.

    What is there already is not done again; run the same command again after a stop.
    """

    part: Annotated[Literal["planners", "zero-shot"], tyro.conf.Positional]
    """planners: images, training and held-out errors. zero-shot: every planner on every arm."""
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

    def run(self) -> None:
        """Do what is missing, one line for each step done."""
        console = Console()
        if self.part == "planners":
            experiments = reproduction.planner_experiments(self.seeds)
            for name in reproduction.render_images(self.data, self.work, self.workers):
                console.print(f"rendered {name}")
            command = shlex.join(["ocplanner", *sys.argv[1:]])
            for name in reproduction.train_all(experiments, self.work, self.results, self.workers):
                out = reproduction.held_out(experiments, self.work, self.results, command)
                console.print(f"trained {name}; errors in {out}")
            return
        for experiment in reproduction.transfer_experiments(self.seeds):
            name = reproduction.transfer(experiment, self.work, self.results, self.episodes, self.workers)
            console.print(f"done {name}")


COMMAND = Reproduce
