"""Many zero-shot episodes of one planner on one robot."""

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from ocplanner.control.settings import ControlSettings
from ocplanner.errors import InvalidValueError, OutputError, WorkerError
from ocplanner.files.journal import Journal
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.storage import check_free, locked
from ocplanner.planner.planner import Planner
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.versions import installed
from ocplanner.zero_shot.result import TransferResult
from ocplanner.zero_shot.scenario import Scenario, Stage, make_scenario
from ocplanner.zero_shot.task_planners import TaskPlanners


def transfer(
    planner: TaskPlanners | Planner | str | Path | Sequence[Planner | str | Path],
    robot: str = "Sawyer",
    *,
    task: str | None = None,
    episodes: int = 50,
    seed_start: int = 10000,
    follow: str = "gated",
    observe: str | None = None,
    visual: str | None = None,
    allow_mismatch: bool = False,
    patches: tuple[str, ...] | None = None,
    control: str = "native",
    mask_error: int = 0,
    pose_noise: tuple[float, float] = (0.0, 0.0),
    pose_latency: int = 0,
    pose_filter: int = 1,
    settings: ControlSettings | None = None,
    workers: int = 1,
    ray: str | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    videos: int = 0,
    command: str | None = None,
    on_episode: Callable[[EpisodeResult], None] | None = None,
) -> TransferResult:
    """Solve a planner's task on a robot that never demonstrated it.

    Args:
        planner: the planner or its file; for a task with several objects, one for each of them.
        robot: name of the arm.
        task: must be the planner's task; here to be checked.
        episodes: how many.
        seed_start: seed of the first episode; the others follow.
        follow: ``gated``, ``time`` or ``open-loop``.
        observe: what the planner sees; the planner's own if not given.
        visual: visual preset; the planner's own if not given.
        allow_mismatch: accept a visual preset that the planner was not trained on.
        patches: corrections of the robot's model; its own if not given, none for ``()``.
        control: who runs the control loop, ``native`` or ``stock``.
        mask_error: pixels by which masks are wrong.
        pose_noise: standard deviations of the object's pose that grasping and following read, drawn anew each control
            step: millimetres along each axis, degrees about an axis of any direction. The verdict stays exact.
        pose_latency: control steps by which that pose is late.
        pose_filter: average what is read over so many control steps, in the hand's frame while it is closed.
        settings: the follower's numbers; ``follow`` overrides theirs.
        workers: processes; the result does not depend on it.
        ray: address of a Ray cluster for the workers; see :func:`ocplanner.rollouts.episodes.run_episodes`.
        out: result file; with it, a transfer that was stopped goes on where it was.
        overwrite: replace ``out`` if it is there.
        videos: record so many of the first episodes beside the result file; those that an earlier run has done
            without recording them are run again.
        command: what remakes the result; the running command if not given.
        on_episode: called with each episode, those of an earlier run included.

    Raises:
        UnknownNameError: a robot, follow mode, visual preset, control loop or patch that does not exist.
        MismatchError: the planner was made for another task, observation or visual preset.
        InvalidValueError: a number is out of its domain.
        OutputError: ``out`` cannot be written, is there already, or holds episodes of another transfer.
        ClusterError: there is no Ray cluster at the address.
    """
    planner = TaskPlanners.of(planner)
    scenario = make_scenario(
        planner,
        robot,
        task=task,
        follow=follow,
        observe=observe,
        visual=visual,
        allow_mismatch=allow_mismatch,
        patches=patches,
        control=control,
        mask_error=mask_error,
        pose_noise=pose_noise,
        pose_latency=pose_latency,
        pose_filter=pose_filter,
        settings=settings,
    )
    return run_transfer(
        scenario,
        planner,
        seeds_of(episodes, seed_start),
        workers=workers,
        ray=ray,
        out=None if out is None else Path(out),
        overwrite=overwrite,
        videos=videos,
        command=command,
        on_episode=on_episode,
    )


def seeds_of(episodes: int, start: int) -> range:
    """One seed an episode.

    Raises:
        InvalidValueError: there are none.
    """
    if episodes < 1:
        raise InvalidValueError(f"episodes is {episodes}, but must be at least 1")
    return range(start, start + episodes)


def run_transfer(
    scenario: Scenario,
    planner: TaskPlanners | Planner,
    seeds: Sequence[int],
    *,
    workers: int = 1,
    ray: str | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    keep: bool = False,
    videos: int = 0,
    examples: int = 0,
    command: str | None = None,
    on_episode: Callable[[EpisodeResult], None] | None = None,
) -> TransferResult:
    """:func:`transfer` of a scenario that is made already.

    Args:
        scenario: what is run.
        planner: the scenario's planner or planners.
        seeds: one an episode.
        workers: processes.
        ray: address of a Ray cluster for the workers.
        out: result file.
        overwrite: replace ``out`` if it holds something else.
        keep: if ``out`` holds the result of these very episodes already, give it back.
        videos: record so many of the first episodes beside the result file.
        examples: record so many successes and so many failures beside it, the first of each: they are run again.
        command: what remakes the result; the running command if not given.
        on_episode: called with each episode that is run, or was by a run that was stopped.

    Raises:
        WorkerError: an episode that was run again for its video ended otherwise.
        OcplannerError: as :func:`transfer` does.
    """
    blank = describe(scenario, planner, command or running_command())
    if out is None:
        runs = _play(scenario, seeds, workers, ray, None, on_episode)
        return replace(blank, runs=tuple(runs[seed] for seed in seeds))
    scenario = replace(scenario, videos=out.with_suffix("").absolute(), filmed=tuple(seeds[:videos]))
    with locked(out):
        kept = _kept(out, blank, seeds, overwrite) if keep and out.is_file() else None
        if kept is not None:
            _film_examples(scenario, kept, examples, workers, ray, again=False)
            return kept
        check_free(out, overwrite)
        journal = Journal(out.with_name(f"{out.name}.journal"), _identity(scenario, planner))
        runs = _play(scenario, seeds, workers, ray, journal, on_episode)
        result = replace(blank, runs=tuple(runs[seed] for seed in seeds))
        _film_examples(scenario, result, examples, workers, ray, again=True)
        result.save(out)
        journal.remove()
    return result


def describe(scenario: Scenario, planner: TaskPlanners | Planner, command: str = "") -> TransferResult:
    """The result of a scenario before any episode of it is run; its file name is known already."""
    return TransferResult(
        task=scenario.task,
        robot=scenario.robot,
        follow=scenario.settings.follow,
        observe=scenario.observe,
        visual=scenario.visual,
        planner_visual=planner.config["visual"],
        control=scenario.control,
        patches=scenario.patches,
        mask_error=scenario.mask_error,
        pose_error=scenario.pose_error,
        pose_filter=scenario.pose_filter,
        planner_sha256=planner.sha256,
        planner_seed=planner.config.get("seed"),
        command=command,
        versions=installed(),
        runs=(),
    )


def running_command() -> str:
    """What was typed to run this."""
    name = Path(sys.argv[0]).name if sys.argv else "ocplanner"
    return shlex.join([name, *sys.argv[1:]])


def _kept(out: Path, blank: TransferResult, seeds: Sequence[int], overwrite: bool) -> TransferResult | None:
    """What the file holds if it is these episodes, of whatever versions; None if it is to be replaced."""
    found = TransferResult.load(out)
    same = replace(found, command=blank.command, versions=blank.versions, runs=()) == blank
    if same and [run.seed for run in found.runs] == list(seeds):
        return found
    if not overwrite:
        raise OutputError(
            f"{out} holds another transfer (other episodes, planner or settings); choose another output, or allow "
            "overwriting (--overwrite; overwrite=True)"
        )
    return None


def _film_examples(
    scenario: Scenario, result: TransferResult, examples: int, workers: int, ray: str | None, *, again: bool
) -> None:
    """Run the first successes and failures again to record them; ``again`` also those whose video is there."""
    good = [run.seed for run in result.runs if run.success][:examples]
    bad = [run.seed for run in result.runs if not run.success][:examples]
    scenario = replace(scenario, filmed=(*good, *bad))
    ended = {run.seed: run for run in result.runs}
    left = [seed for seed in scenario.filmed if again or not _is_there(scenario.video(seed))]
    for seed, run in run_episodes(scenario.make, Stage.play, left, WorkerSettings(workers, ray)):
        if run != ended[seed]:
            raise WorkerError(
                f"the episode of seed {seed} of {result.task} on {result.robot} ended otherwise when it was run again "
                f"for its video ({run} after {ended[seed]}); delete its result, or leave --videos out"
            )


def _is_there(path: Path | None) -> bool:
    return path is not None and path.exists()


def _play(
    scenario: Scenario,
    seeds: Sequence[int],
    workers: int,
    ray: str | None,
    journal: Journal | None,
    on_episode: Callable[[EpisodeResult], None] | None,
) -> dict[int, EpisodeResult]:
    runs = {} if journal is None else {seed: journal.runs[seed] for seed in seeds if _done(scenario, journal, seed)}
    for run in runs.values():
        if on_episode is not None:
            on_episode(run)
    left = [seed for seed in seeds if seed not in runs]
    if not left:
        return runs
    for seed, run in run_episodes(scenario.make, Stage.play, left, WorkerSettings(workers, ray)):
        runs[seed] = run
        if journal is not None:
            journal.add(run, filmed=scenario.video(seed) is not None)
        if on_episode is not None:
            on_episode(run)
    return runs


def _done(scenario: Scenario, journal: Journal, seed: int) -> bool:
    """Whether an earlier run leaves nothing to do for this seed: its episode, and its video if one is wanted.

    A video that the journal does not know of may be of another transfer with the same output.
    """
    video = scenario.video(seed)
    return seed in journal.runs and (video is None or (seed in journal.filmed and video.exists()))


def _identity(scenario: Scenario, planner: TaskPlanners | Planner) -> dict[str, Any]:
    content = asdict(scenario)
    for key in ("planners", "videos", "filmed"):
        del content[key]
    return {**content, "planner_sha256": planner.sha256, "versions": installed()}
