"""What one episode of a transfer needs, and its run in a worker."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from ocplanner.control.noisy_mask import NoisyMask
from ocplanner.control.noisy_pose import PoseError
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.environment import CONTROL_LOOPS, ManipulationEnv, make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import task as task_spec
from ocplanner.envs.visuals import visual_preset
from ocplanner.errors import InvalidValueError, MismatchError, UnknownNameError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.planner.planner import Planner
from ocplanner.zero_shot.episode import run_episode
from ocplanner.zero_shot.recording import Recorder
from ocplanner.zero_shot.task_planners import TaskPlanners


@dataclass(frozen=True)
class Scenario:
    """What one worker needs to run any of the episodes.

    Attributes:
        planners: the planner files, one an object in the task's order.
        task: name of the task.
        robot: name of the robot.
        observe: what the planner sees.
        cameras: the planners' cameras.
        image_size: side of its pictures, pixels.
        visual: visual preset.
        patches: corrections of the model.
        control: who runs the control loop.
        mask_error: pixels by which masks are wrong.
        pose_error: how wrong the object's pose is that grasping and following read.
        pose_filter: control steps over which what is read is averaged, 1 for none.
        settings: the follower's numbers.
        videos: folder of videos, or None.
        filmed: seeds whose episodes are recorded.
    """

    planners: tuple[Path, ...]
    task: str
    robot: str
    observe: str
    cameras: tuple[str, ...]
    image_size: int
    visual: str
    patches: tuple[str, ...]
    control: str = "native"
    mask_error: int = 0
    pose_error: PoseError = field(default_factory=PoseError)
    pose_filter: int = 1
    settings: ControlSettings = field(default_factory=ControlSettings)
    videos: Path | None = None
    filmed: tuple[int, ...] = ()

    def video(self, seed: int) -> Path | None:
        """The file that an episode is recorded to, or None if it is not recorded."""
        return self.videos / f"episode_{seed}.mp4" if self.videos is not None and seed in self.filmed else None

    def make(self) -> "Stage":
        """Load the planners and put the robot before their task."""
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
        return Stage(self, env, TaskPlanners.of(self.planners))


class Stage:
    """A scenario set up in a process."""

    def __init__(self, scenario: Scenario, env: ManipulationEnv, planners: TaskPlanners) -> None:
        """Keep the parts."""
        self.scenario, self.env, self.planners = scenario, env, planners

    def play(self, seed: int) -> EpisodeResult:
        """Run one episode."""
        scenario = self.scenario
        video = scenario.video(seed)
        recorder = None if video is None else Recorder(self.env)
        sight = NoisyMask(scenario.mask_error, seed)
        episode = run_episode(
            self.env,
            self.planners.by_object,
            seed,
            scenario.settings,
            observe=sight.observe,
            pose_error=scenario.pose_error,
            pose_filter=scenario.pose_filter,
            on_step=recorder,
        )
        if recorder is not None and video is not None:
            recorder.write(video, episode)
        return EpisodeResult(
            seed, episode.success, episode.steps, episode.failure, episode.released_by, episode.failed_with
        )

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()


def make_scenario(
    planner: TaskPlanners | Planner,
    robot: str,
    *,
    task: str | None = None,
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
) -> Scenario:
    """What the planner file says about how it wants to see, checked against what is asked for.

    Args:
        planner: the planner, or those of a task with several objects.
        robot: name of the arm.
        task: must be the planner's task; here to be checked.
        follow: ``gated``, ``time`` or ``open-loop``.
        observe: what the planner sees; the planner's own if not given.
        visual: visual preset; the planner's own if not given.
        allow_mismatch: accept a visual preset that the planner was not trained on.
        patches: corrections of the robot's model; its own if not given, none for ``()``.
        control: who runs the control loop, ``native`` or ``stock``.
        mask_error: pixels by which masks are wrong.
        pose_noise: standard deviations of the object's pose that is read: millimetres along each axis, degrees about
            an axis of any direction; see :class:`ocplanner.control.noisy_pose.PoseError`.
        pose_latency: control steps by which that pose is late.
        pose_filter: average what is read over so many control steps; see
            :class:`ocplanner.control.pose_filter.FilteredArm`.
        settings: the follower's numbers; ``follow`` overrides theirs.

    Raises:
        UnknownNameError: no such robot, task, follow mode, visual preset or control loop.
        MismatchError: the planner was made for another task, object, observation or visual preset.
        InvalidValueError: an error is negative, or ``pose_filter`` not positive.
    """
    planners = TaskPlanners.of(planner)
    config, spec, arm = planners.config, planners.task, robot_spec(robot)
    if control not in CONTROL_LOOPS:
        raise UnknownNameError("control loop", control, CONTROL_LOOPS)
    if task is not None and task_spec(task).name != spec.name:
        raise MismatchError(f"{planners} plans for the task {spec.name}, not {task}; train a planner on {task}")
    if observe is not None and observe != config["observe"]:
        raise MismatchError(
            f"{planners} was trained on observe={config['observe']}, not {observe}; "
            f"leave --observe out, or train a planner with --observe {observe}"
        )
    if pose_filter < 1:
        raise InvalidValueError(f"pose_filter is {pose_filter} steps, but must be at least 1")
    if mask_error < 0:
        raise InvalidValueError(f"mask_error is {mask_error} pixels, but must not be negative")
    if mask_error and config["observe"] != "masked":
        raise MismatchError(f"a mask error needs a planner trained on observe=masked, not {config['observe']}")
    return Scenario(
        planners=planners.paths,
        task=spec.name,
        robot=arm.name,
        observe=str(config["observe"]),
        cameras=planners.cameras,
        image_size=int(config["image_size"]),
        visual=_preset(planners, visual, allow_mismatch),
        patches=arm.patches if patches is None else tuple(patches),
        control=control,
        mask_error=mask_error,
        pose_error=PoseError(*pose_noise, pose_latency),
        pose_filter=pose_filter,
        settings=replace(settings or ControlSettings(), follow=follow),
    )


def _preset(planners: TaskPlanners, asked: str | None, allow_mismatch: bool) -> str:
    """The visual preset to draw with: the one that the planner was trained on, unless another is wanted knowingly."""
    trained = planners.config["visual"]
    if asked is None and trained is None:
        raise MismatchError(
            f"{planners} does not say with which visual preset its images were drawn; "
            f"name it with --visual (robosuite's own pictures are stock)"
        )
    name = visual_preset(trained if asked is None else asked).name
    if trained is not None and name != trained and not allow_mismatch:
        raise MismatchError(
            f"{planners} was trained on the visual preset {trained}, not {name}; leave --visual out, train "
            f"a planner on images that `ocplanner render --visual {name}` draws, or add --allow-mismatch"
        )
    return name
