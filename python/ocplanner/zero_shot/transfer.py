"""Many zero-shot episodes of one planner on one robot."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from ocplanner.errors import InvalidValueError
from ocplanner.files.journal import Journal
from ocplanner.files.records.episode import MOST_EPISODES, EpisodeResult
from ocplanner.files.storage import check_output, locked
from ocplanner.planner.planner import Planner
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import FIRST_EVALUATION_SEED, WorkerSettings
from ocplanner.settings import require, require_seed
from ocplanner.zero_shot.result import TransferResult, with_episodes
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.setup import EpisodeRunner, TransferSetup
from ocplanner.zero_shot.task_planners import TaskPlanners


def transfer(
    planner: TaskPlanners | Planner | str | Path | Sequence[Planner | str | Path],
    robot: str = "Sawyer",
    *,
    episodes: int | Sequence[int] = 50,
    config: TransferConfig | None = None,
    workers: WorkerSettings | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    videos: int = 0,
    on_episode: Callable[[EpisodeResult], None] | None = None,
) -> TransferResult:
    """Solve a planner's task on a robot that never demonstrated it.

    Args:
        planner: the planner or its file; for a task with several objects, one for each of them.
        robot: name of the arm.
        episodes: how many, from seed 10000 on; or the seed of each.
        config: the conditions.
        workers: where episodes run; the result does not depend on it.
        out: result file; with it, a transfer that was stopped continues where it stopped.
        overwrite: replace ``out`` if it exists.
        videos: record this many of the first episodes beside ``out``; episodes that an interrupted run did not record
            are run again.
        on_episode: called with each episode, those of an interrupted run included.

    Raises:
        UnknownNameError: a robot that does not exist.
        ModelFileError: a file is no planner.
        MismatchError: the planner was made for another observation or visual preset.
        InvalidValueError: there is no episode, or ``videos`` without ``out``.
        OutputError: ``out`` cannot be written, is there already, or holds episodes of another transfer.
        ClusterError: there is no Ray cluster at the address.
    """
    return run_transfer(
        TransferSetup.of(planner, robot, config),
        seeds_of(episodes),
        workers=workers,
        out=None if out is None else Path(out),
        overwrite=overwrite,
        videos=videos,
        on_episode=on_episode,
    )


def seeds_of(episodes: int | Sequence[int], start: int = FIRST_EVALUATION_SEED) -> Sequence[int]:
    """The seed of each episode.

    Args:
        episodes: how many; or the seeds.
        start: seed of the first of so many.

    Raises:
        InvalidValueError: there are none or too many, or one is negative or no whole number.
    """
    seeds = range(start, start + max(episodes, 0)) if isinstance(episodes, int) else episodes
    require(len(seeds) > 0, f"episodes is {episodes}, but must be at least 1")
    require(len(seeds) <= MOST_EPISODES, f"episodes is {episodes}, but must be at most {MOST_EPISODES}")
    for seed in (seeds[0], seeds[-1]) if isinstance(seeds, range) else seeds:
        require_seed(seed)
    return seeds


def run_transfer(
    setup: TransferSetup,
    seeds: Sequence[int],
    *,
    workers: WorkerSettings | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    videos: int = 0,
    on_episode: Callable[[EpisodeResult], None] | None = None,
) -> TransferResult:
    """:func:`transfer` of a setup that is checked already; arguments and errors are the same."""
    if out is None:
        if videos:
            raise InvalidValueError(
                f"videos is {videos}, but without out there is no place for them; give a result file"
            )
        return play(setup, seeds, workers, None, on_episode)
    check_output(out, overwrite, "JSON result", setup.planners)
    setup = setup.filming(out, seeds[:videos])
    with locked(out):
        check_output(out, overwrite, "JSON result")
        journal = journal_of(setup, out)
        result = play(setup, seeds, workers, journal, on_episode)
        result.save(out)
        journal.remove()
    return result


def journal_of(setup: TransferSetup, out: Path) -> Journal:
    """The journal of the transfer whose result file is ``out``, with the episodes of an interrupted run.

    Raises:
        OutputError: it belongs to another transfer, or is damaged.
    """
    identity = {**setup.result.identity, "versions": setup.result.versions}
    return Journal(out.with_name(f"{out.name}.journal"), identity)


def play(
    setup: TransferSetup,
    seeds: Sequence[int],
    workers: WorkerSettings | None,
    journal: Journal | None,
    on_episode: Callable[[EpisodeResult], None] | None,
) -> TransferResult:
    """Run the episodes that the journal lacks, and put all of them into the result in the order of the seeds."""
    workers = workers or WorkerSettings()
    runs = {} if journal is None else {seed: journal.runs[seed] for seed in seeds if _done(setup, journal, seed)}
    for run in runs.values():
        if on_episode is not None:
            on_episode(run)
    left = [seed for seed in seeds if seed not in runs]
    played = run_episodes(partial(EpisodeRunner, setup), EpisodeRunner.play, left, workers)
    for seed, run in played:
        runs[seed] = run
        if journal is not None:
            journal.add(run, filmed=setup.video(seed) is not None)
        if on_episode is not None:
            on_episode(run)
    return with_episodes(setup.result, (runs[seed] for seed in seeds))


def _done(setup: TransferSetup, journal: Journal, seed: int) -> bool:
    """Whether the journal has the episode of this seed, and its video if it is to be filmed.

    A video that the journal does not know may be of another transfer with the same output.
    """
    video = setup.video(seed)
    return seed in journal.runs and (video is None or (seed in journal.filmed and video.exists()))
