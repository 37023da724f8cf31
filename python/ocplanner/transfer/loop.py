"""Many zero-shot episodes of one planner on one robot."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ocplanner.envs.environment import CONTROL_LOOPS, ManipulationEnv, make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import task as task_spec
from ocplanner.envs.visuals import visual_preset
from ocplanner.errors import InvalidValueError, MismatchError, UnknownNameError
from ocplanner.evaluation.rollouts import run_episodes
from ocplanner.planner.planner import Planner
from ocplanner.storage import check_free, locked
from ocplanner.transfer.episode import run_episode
from ocplanner.transfer.journal import Journal
from ocplanner.transfer.mask_error import ErringMask
from ocplanner.transfer.recording import Recorder
from ocplanner.transfer.result import Run, TransferResult, result_name
from ocplanner.transfer.settings import TransferSettings
from ocplanner.versions import installed


@dataclass(frozen=True)
class Scenario:
    """What one worker needs to run any of the episodes.

    Attributes:
        planner: the planner file.
        task: name of the task.
        robot: name of the robot.
        observe: what the planner sees.
        cameras: the planner's cameras.
        image_size: side of its pictures, pixels.
        visual: visual preset.
        patches: corrections of the model.
        control: who runs the control loop.
        mask_error: pixels by which masks are wrong.
        settings: the follower's numbers.
        videos: folder of videos, or None.
        filmed: seeds whose episodes are recorded.
    """

    planner: Path
    task: str
    robot: str
    observe: str
    cameras: tuple[str, ...]
    image_size: int
    visual: str
    patches: tuple[str, ...]
    control: str = "native"
    mask_error: int = 0
    settings: TransferSettings = field(default_factory=TransferSettings)
    videos: Path | None = None
    filmed: tuple[int, ...] = ()

    def video(self, seed: int) -> Path | None:
        """The file that an episode is recorded to, or None if it is not recorded."""
        return self.videos / f"episode_{seed}.mp4" if self.videos is not None and seed in self.filmed else None

    def make(self) -> "Stage":
        """Load the planner and put the robot before its task."""
        env = make_env(
            self.task,
            self.robot,
            cameras=self.cameras,
            image_size=self.image_size,
            visual=self.visual,
            observe=self.observe,
            patches=self.patches,
            control=self.control,
        )
        return Stage(self, env, Planner.load(self.planner))


class Stage:
    """A scenario set up in a process."""

    def __init__(self, scenario: Scenario, env: ManipulationEnv, planner: Planner) -> None:
        """Keep the parts."""
        self.scenario, self.env, self.planner = scenario, env, planner

    def play(self, seed: int) -> Run:
        """Run one episode."""
        scenario = self.scenario
        video = scenario.video(seed)
        recorder = None if video is None else Recorder(self.env)
        sight = ErringMask(scenario.mask_error, seed)
        episode = run_episode(self.env, self.planner, seed, scenario.settings, observe=sight.observe, on_step=recorder)
        if recorder is not None and video is not None:
            recorder.write(video, episode)
        return Run(seed, episode.success, episode.steps, episode.failure, episode.released_by)

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()


def transfer(
    planner: Planner | str | Path,
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
    settings: TransferSettings | None = None,
    workers: int = 1,
    ray: str | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    videos: int = 0,
    command: str | None = None,
    on_episode: Callable[[Run], None] | None = None,
) -> TransferResult:
    """Solve a planner's task on a robot that never demonstrated it.

    Args:
        planner: the planner or its file.
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
        settings: the follower's numbers; ``follow`` overrides theirs.
        workers: processes; the result does not depend on it.
        ray: address of a Ray cluster for the workers; see :func:`ocplanner.evaluation.rollouts.run_episodes`.
        out: result file; with it, a transfer that was stopped goes on where it was.
        overwrite: replace ``out`` if it is there.
        videos: record so many of the first episodes beside the result file; those that an earlier run has done
            without recording them are run again.
        command: what remakes the result; the running command if not given.
        on_episode: called with each episode, those of an earlier run included.

    Raises:
        UnknownNameError: a robot, follow mode, visual preset, control loop or patch that does not exist.
        MismatchError: the planner was made for another task, observation or visual preset.
        OutputError: ``out`` cannot be written, is there already, or holds episodes of another transfer.
        ClusterError: there is no Ray cluster at the address.
    """
    planner = planner if isinstance(planner, Planner) else Planner.load(planner)
    if episodes < 1:
        raise InvalidValueError(f"episodes is {episodes}, but must be at least 1")
    scenario = make_scenario(
        planner,
        robot,
        task=task,
        observe=observe,
        visual=visual,
        allow_mismatch=allow_mismatch,
        patches=patches,
        control=control,
        mask_error=mask_error,
    )
    scenario = replace(scenario, settings=replace(settings or TransferSettings(), follow=follow))
    seeds = range(seed_start, seed_start + episodes)
    if out is None:
        runs = _play(scenario, seeds, workers, ray, None, on_episode)
    else:
        out = Path(out)
        check_free(out, overwrite)
        scenario = replace(scenario, videos=out.with_suffix("").absolute(), filmed=tuple(seeds[:videos]))
        with locked(out):
            journal = Journal(out.with_name(f"{out.name}.journal"), _identity(scenario, planner))
            runs = _play(scenario, seeds, workers, ray, journal, on_episode)
    result = TransferResult(
        task=scenario.task,
        robot=scenario.robot,
        follow=follow,
        observe=scenario.observe,
        visual=scenario.visual,
        planner_visual=planner.config["visual"],
        control=scenario.control,
        patches=scenario.patches,
        mask_error=mask_error,
        planner_sha256=planner.sha256,
        planner_seed=planner.config.get("seed"),
        command=command or _running_command(),
        versions=installed(),
        runs=tuple(runs[seed] for seed in seeds),
    )
    if isinstance(out, Path):
        result.save(out)
        out.with_name(f"{out.name}.journal").unlink(missing_ok=True)
    return result


def make_scenario(
    planner: Planner,
    robot: str,
    *,
    task: str | None = None,
    observe: str | None = None,
    visual: str | None = None,
    allow_mismatch: bool = False,
    patches: tuple[str, ...] | None = None,
    control: str = "native",
    mask_error: int = 0,
) -> Scenario:
    """What the planner file says about how it wants to see, checked against what is asked for.

    Raises:
        UnknownNameError: no such robot, task, visual preset or control loop.
        MismatchError: the planner was made for another task, object, observation or visual preset.
        InvalidValueError: ``mask_error`` is negative.
    """
    config = planner.config
    spec, arm = task_spec(str(config["task"])), robot_spec(robot)
    if control not in CONTROL_LOOPS:
        raise UnknownNameError("control loop", control, CONTROL_LOOPS)
    if task is not None and task_spec(task).name != spec.name:
        raise MismatchError(f"{planner.path} plans for the task {spec.name}, not {task}; train a planner on {task}")
    if config["object"] not in {candidate.name for candidate in spec.objects}:
        raise MismatchError(
            f"{planner.path} plans for the object {config['object']!r}, which {spec.name} does not have"
        )
    if observe is not None and observe != config["observe"]:
        raise MismatchError(
            f"{planner.path} was trained on observe={config['observe']}, not {observe}; "
            f"leave --observe out, or train a planner with --observe {observe}"
        )
    if mask_error < 0:
        raise InvalidValueError(f"mask_error is {mask_error} pixels, but must not be negative")
    if mask_error and config["observe"] != "masked":
        raise MismatchError(f"a mask error needs a planner trained on observe=masked, not {config['observe']}")
    return Scenario(
        planner=Path(planner.path).absolute(),
        task=spec.name,
        robot=arm.name,
        observe=str(config["observe"]),
        cameras=tuple(config["cameras"]),
        image_size=int(config["image_size"]),
        visual=_preset(planner, visual, allow_mismatch),
        patches=arm.patches if patches is None else tuple(patches),
        control=control,
        mask_error=mask_error,
    )


def _preset(planner: Planner, asked: str | None, allow_mismatch: bool) -> str:
    """The visual preset to draw with: the one that the planner was trained on, unless another is wanted knowingly."""
    trained = planner.config["visual"]
    if asked is None and trained is None:
        raise MismatchError(
            f"{planner.path} does not say with which visual preset its images were drawn; "
            f"name it with --visual (robosuite's own pictures are stock)"
        )
    name = visual_preset(trained if asked is None else asked).name
    if trained is not None and name != trained and not allow_mismatch:
        raise MismatchError(
            f"{planner.path} was trained on the visual preset {trained}, not {name}; leave --visual out, train "
            f"a planner on images that `ocplanner render --visual {name}` draws, or add --allow-mismatch"
        )
    return name


def result_path(
    planner: Planner,
    robot: str,
    follow: str,
    mask_error: int = 0,
    visual: str | None = None,
    root: Path = Path("results"),
) -> Path:
    """Where a result belongs, such as ``results/transfer/square_sawyer_gated_masked_0.json``."""
    config = planner.config
    other = None if visual == config["visual"] else visual
    name = result_name(config["task"], robot, follow, config["observe"], config.get("seed"), mask_error, other)
    return root / "transfer" / name


def _play(
    scenario: Scenario,
    seeds: range,
    workers: int,
    ray: str | None,
    journal: Journal | None,
    on_episode: Callable[[Run], None] | None,
) -> dict[int, Run]:
    runs = {} if journal is None else {seed: journal.runs[seed] for seed in seeds if _done(scenario, journal, seed)}
    for run in runs.values():
        if on_episode is not None:
            on_episode(run)
    left = [seed for seed in seeds if seed not in runs]
    if not left:
        return runs
    for seed, run in run_episodes(scenario.make, Stage.play, left, workers, ray=ray):
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


def _identity(scenario: Scenario, planner: Planner) -> dict[str, Any]:
    content = asdict(scenario)
    for key in ("planner", "videos", "filmed"):
        del content[key]
    return {**content, "planner_sha256": planner.sha256, "versions": installed()}


def _running_command() -> str:
    name = Path(sys.argv[0]).name if sys.argv else "ocplanner"
    return shlex.join([name, *sys.argv[1:]])
