"""Every task on every arm: one transfer a cell."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError, ModelFileError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import atomic_json, locked
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot.loop import describe, run_transfer, running_command, seeds_of
from ocplanner.zero_shot.result import TransferResult
from ocplanner.zero_shot.scenario import make_scenario
from ocplanner.zero_shot.task_planners import TaskPlanners

SUFFIX = ".safetensors"


@dataclass(frozen=True)
class Matrix:
    """Transfers of one planner a task, or one an object of it, to several robots.

    Attributes:
        command: remakes it.
        cells: task by task, robot by robot, as far as they have been run.
    """

    command: str
    cells: tuple[TransferResult, ...]

    def save(self, path: Path) -> Path:
        """Write the file, whole or not at all."""
        atomic_json(path, {"command": self.command, "cells": [cell.to_json() for cell in self.cells]})
        return path


def find_planners(paths: Iterable[str | Path], seed: int = 0) -> list[TaskPlanners]:
    """The planners of a matrix, by task.

    Args:
        paths: planner files, and folders of which those of one training seed are taken.
        seed: that training seed.

    Raises:
        ModelFileError: a file is no planner, or there are none.
        InvalidValueError: several planners are for the same object of a task.
        MismatchError: an object of a task has no planner.
    """
    paths = [Path(path) for path in paths]
    planners: list[Planner] = []
    for path in paths:
        if path.is_dir():
            found = map(Planner.load, sorted(path.glob(f"*{SUFFIX}")))
            planners += [planner for planner in found if planner.config.get("seed") in (seed, None)]
        else:
            planners.append(Planner.load(path))
    if not planners:
        raise ModelFileError(
            f"no planner ({SUFFIX}) of training seed {seed} in {', '.join(map(str, paths)) or 'no path at all'}; name "
            "planner files, or a folder that holds one a task"
        )
    by_task: dict[str, dict[str, Planner]] = {}
    for planner in planners:
        by_object = by_task.setdefault(str(planner.config["task"]), {})
        other = by_object.setdefault(str(planner.config["object"]), planner)
        if other is not planner:
            raise InvalidValueError(
                f"{other.path} and {planner.path} both plan for {planner.config['task']}, but a matrix has one planner "
                "a task, or one an object of it; name the files"
            )
    return [TaskPlanners(list(by_task[task].values())) for task in sorted(by_task)]


def transfer_matrix(
    planners: Sequence[TaskPlanners],
    robots: Sequence[str] = tuple(ROBOTS),
    *,
    out: str | Path,
    episodes: int = 50,
    seed_start: int = 10000,
    workers: int = 1,
    ray: str | None = None,
    overwrite: bool = False,
    videos: int = 0,
    command: str | None = None,
    on_start: Callable[[TransferResult], None] | None = None,
    on_episode: Callable[[EpisodeResult], None] | None = None,
    on_cell: Callable[[TransferResult], None] | None = None,
    **conditions: Any,
) -> Matrix:
    """Try every planner on every robot, one cell after another, its episodes side by side.

    Each cell is a result file in the folder called as ``out`` without its ending; ``out`` holds the cells done so far
    and is rewritten after each. A cell whose file is there is not run again, so that a matrix that was stopped goes on
    where it was.

    Args:
        planners: one a task; see :func:`find_planners`.
        robots: names of the arms.
        out: the matrix's file.
        episodes: of each cell.
        seed_start: seed of the first episode; the others follow.
        workers: processes.
        ray: address of a Ray cluster for the workers.
        overwrite: replace cells whose file holds other episodes, or those of another planner or other conditions.
        videos: record so many successes and so many failures of each cell.
        command: what remakes the matrix; the running command if not given.
        on_start: called with each cell before its episodes.
        on_episode: called with each episode that is run.
        on_cell: called with each cell that is done, when ``out`` holds it.
        **conditions: the same for all cells, as :func:`ocplanner.zero_shot.scenario.make_scenario` takes them.

    Raises:
        UnknownNameError: no such robot.
        OutputError: ``out`` cannot be written, or a cell's file holds another transfer.
        OcplannerError: as :func:`ocplanner.zero_shot.loop.transfer` does.
    """
    out = Path(out)
    seeds = seeds_of(episodes, seed_start)
    scenarios = [
        (make_scenario(planner, robot, **conditions), planner)
        for planner in planners
        for robot in dict.fromkeys(robots)
    ]
    matrix = Matrix(command or running_command(), ())
    with locked(out):
        for scenario, planner in scenarios:
            cell = describe(scenario, planner)
            if on_start is not None:
                on_start(cell)
            cell = run_transfer(
                scenario,
                planner,
                seeds,
                workers=workers,
                ray=ray,
                out=out.with_suffix("") / cell.file_name,
                overwrite=overwrite,
                keep=True,
                examples=videos,
                command=matrix.command,
                on_episode=on_episode,
            )
            matrix = Matrix(matrix.command, (*matrix.cells, cell))
            matrix.save(out)
            if on_cell is not None:
                on_cell(cell)
    return matrix
