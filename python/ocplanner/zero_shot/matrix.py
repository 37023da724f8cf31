"""Every task on every arm: one transfer a cell."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ocplanner.envs.robots import ROBOTS
from ocplanner.errors import InvalidValueError, ModelFileError, OutputError, WorkerError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import check_output, locked
from ocplanner.planner.planner import Planner
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import require_names
from ocplanner.versions import running_command
from ocplanner.zero_shot.result import Matrix, TransferResult, read_result, read_results
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup
from ocplanner.zero_shot.task_planners import TaskPlanners
from ocplanner.zero_shot.transfer import journal_of, play, seeds_of

SUFFIX = ".safetensors"


def _ignore(_: object) -> None:
    """Do nothing."""


@dataclass(frozen=True)
class MatrixProgress:
    """Callbacks of a matrix.

    Attributes:
        begin: called with each cell, still without episodes, before it is run or read.
        episode: called with each episode, those of an interrupted run included.
        done: called with each finished cell, once the matrix's file holds it.
    """

    begin: Callable[[TransferResult], None] = _ignore
    episode: Callable[[EpisodeResult], None] = _ignore
    done: Callable[[TransferResult], None] = _ignore


def find_planners(paths: Iterable[str | Path], seed: int = 0) -> list[TaskPlanners]:
    """The planners of a matrix, by task.

    Args:
        paths: planner files, and folders, of which the files of one training seed are taken.
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
            planners += [planner for planner in found if planner.header.seed in (seed, None)]
        else:
            planners.append(Planner.load(path))
    if not planners:
        raise ModelFileError(
            f"no planner ({SUFFIX}) of training seed {seed} in {', '.join(map(str, paths)) or 'no path at all'}; name "
            "planner files, or a folder that holds one a task"
        )
    by_task: dict[str, dict[str, Planner]] = {}
    for planner in planners:
        by_object = by_task.setdefault(planner.header.task, {})
        other = by_object.setdefault(planner.header.object, planner)
        if other is not planner:
            raise InvalidValueError(
                f"{other.path} and {planner.path} both plan for {planner.header.task}, but a matrix has one planner "
                "a task, or one an object of it; name the files"
            )
    return [TaskPlanners(list(by_task[task].values())) for task in sorted(by_task)]


def transfer_matrix(
    planners: Sequence[TaskPlanners],
    robots: Sequence[str] = tuple(ROBOTS),
    *,
    out: str | Path,
    episodes: int | Sequence[int] = 50,
    config: TransferConfig | None = None,
    workers: WorkerSettings | None = None,
    overwrite: bool = False,
    videos: int = 0,
    progress: MatrixProgress | None = None,
) -> Matrix:
    """Try every planner on every robot, one cell after another, its episodes side by side.

    Each cell is a result file in a folder named like ``out`` without its suffix. ``out`` gathers the cells and is
    rewritten after each; it keeps its cells of other tasks, robots and conditions. A cell whose file exists is not run
    again, so a matrix that was stopped continues where it stopped.

    Args:
        planners: one for each task; see :func:`find_planners`.
        robots: names of the arms.
        out: the matrix's file.
        episodes: of each cell: how many, from seed 10000 on; or the seed of each.
        config: the conditions of all cells.
        workers: where episodes run.
        overwrite: replace cells that hold other episodes, or those of another planner.
        videos: record the first so many successes and failures of each cell, by running them again.
        progress: callbacks.

    Returns:
        The content of ``out``.

    Raises:
        UnknownNameError: no such robot.
        ResultFileError: ``out`` is damaged.
        OutputError: ``out`` cannot be written, or a cell holds another transfer.
        WorkerError: an episode that was run again for its video ended otherwise.
        OcplannerError: as :func:`ocplanner.zero_shot.transfer.transfer` does.
    """
    out, workers, progress = Path(out), workers or WorkerSettings(), progress or MatrixProgress()
    seeds, robots = seeds_of(episodes), require_names("robots", robots)
    setups = [TransferSetup.of(planner, robot, config) for planner in planners for robot in dict.fromkeys(robots)]
    check_output(out, overwrite, "JSON result", (path for setup in setups for path in setup.planners), resumed=True)
    with locked(out):
        cells = {cell.file_name: cell for cell in (read_results(out) if out.exists() else ())}
        matrix = Matrix(running_command(), tuple(cells.values()))
        for setup in setups:
            progress.begin(setup.result)
            name = setup.result.file_name
            cell = _Cell(setup, seeds, workers, out.with_suffix("") / name)
            if name in cells and not cell.out.exists() and not overwrite:
                _check_same(out, cells[name], setup, seeds)
            cells[name] = cell.result(overwrite, videos, progress)
            matrix = replace(matrix, cells=tuple(sorted(cells.values(), key=_place)))
            matrix.save(out)
            progress.done(cells[name])
    return matrix


class _Cell:
    """One transfer of a matrix and its file."""

    def __init__(self, setup: TransferSetup, seeds: Sequence[int], workers: WorkerSettings, out: Path) -> None:
        self.setup, self.seeds, self.workers, self.out = setup, seeds, workers, out

    def result(self, overwrite: bool, videos: int, progress: MatrixProgress) -> TransferResult:
        """The file's content if it is this transfer; otherwise run the episodes and write it."""
        with locked(self.out):
            if self.out.is_file():
                found = read_result(self.out)
                if _is_same(found, self.setup, self.seeds):
                    self._film(found, videos, again=False)
                    return found
                if not overwrite:
                    _check_same(self.out, found, self.setup, self.seeds)
            check_output(self.out, overwrite, "JSON result", self.setup.planners)
            journal = journal_of(self.setup, self.out)
            result = play(self.setup, self.seeds, self.workers, journal, progress.episode)
            self._film(result, videos, again=True)
            result.save(self.out)
            journal.remove()
        return result

    def _film(self, result: TransferResult, videos: int, *, again: bool) -> None:
        """Run the first successes and failures again to record them; with ``again`` also those that have a video."""
        good = [run.seed for run in result.runs if run.success][:videos]
        bad = [run.seed for run in result.runs if not run.success][:videos]
        setup = self.setup.filming(self.out, (*good, *bad))
        left = [seed for seed in setup.filmed if again or not _exists(setup.video(seed))]
        for seed, run in run_episodes(partial(EpisodeRunner, setup), EpisodeRunner.play, left, self.workers):
            if run != result.episode(seed):
                raise WorkerError(
                    f"the episode of seed {seed} of {result.task} on {result.robot} ended otherwise when it was run "
                    f"again for its video ({run} after {result.episode(seed)}); delete its result, or leave --videos "
                    "out"
                )


def _exists(path: Path | None) -> bool:
    return path is not None and path.exists()


def _is_same(found: TransferResult, setup: TransferSetup, seeds: Sequence[int]) -> bool:
    """Whether a result is of this transfer and these episodes, whatever the versions."""
    wanted = setup.result
    same = (found.conditions, found.planner_sha256) == (wanted.conditions, wanted.planner_sha256)
    return same and [run.seed for run in found.runs] == list(seeds)


def _check_same(path: Path, found: TransferResult, setup: TransferSetup, seeds: Sequence[int]) -> None:
    if not _is_same(found, setup, seeds):
        raise OutputError(
            f"{path} holds another transfer of {found.title} (other episodes, planner or settings); choose another "
            "output, or allow overwriting (--overwrite; overwrite=True)"
        )


def _place(cell: TransferResult) -> tuple[str, int, str]:
    """Task by task, the robots of each in the package's order."""
    known = list(ROBOTS)
    return cell.task, known.index(cell.robot) if cell.robot in known else len(known), cell.file_name
