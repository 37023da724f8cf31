"""What one episode of a transfer needs, and its run in a worker."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from ocplanner.control.noisy_mask import NoisyMask
from ocplanner.envs import CONTROL_HZ
from ocplanner.envs.environment import make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.visuals import visual_preset
from ocplanner.errors import MismatchError
from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.records.transfer import privileged_inputs
from ocplanner.planner.planner import Planner
from ocplanner.versions import installed, running_command
from ocplanner.zero_shot.episode import Episode, run_episode
from ocplanner.zero_shot.recording import Recorder
from ocplanner.zero_shot.result import TransferResult
from ocplanner.zero_shot.settings import TransferConfig
from ocplanner.zero_shot.task_planners import TaskPlanners


@dataclass(frozen=True)
class TransferSetup:
    """What a worker needs to run any of the episodes.

    Attributes:
        result: the transfer's result before its first episode; it holds task, robot and settings.
        planners: planner files in the task's order.
        cameras: cameras of all planners.
        image_size: width and height of their images, pixels.
        videos: folder of videos, or None.
        filmed: seeds whose episodes are recorded.
    """

    result: TransferResult
    planners: tuple[Path, ...]
    cameras: tuple[str, ...]
    image_size: int
    videos: Path | None = None
    filmed: tuple[int, ...] = ()

    @classmethod
    def of(
        cls,
        planner: TaskPlanners | Planner | str | Path | Sequence[Planner | str | Path],
        robot: str = "Sawyer",
        config: TransferConfig | None = None,
    ) -> Self:
        """Check the conditions against what the planner file says about its images.

        Args:
            planner: the planner or its file; for a task with several objects, one for each of them.
            robot: name of the arm.
            config: the conditions.

        Raises:
            UnknownNameError: there is no such robot.
            ModelFileError: a file is no planner.
            MismatchError: the planner was made for another visual preset or observation.
        """
        planners, arm, config = TaskPlanners.of(planner), robot_spec(robot), config or TransferConfig()
        header = planners.header
        if config.mask_error and header.observe != "masked":
            raise MismatchError(f"a mask error needs a planner trained on observe=masked, not {header.observe}")
        drawn = _preset(planners, config)
        foreign = drawn if drawn != header.visual else None
        result = TransferResult(
            task=planners.task.name,
            robot=arm.name,
            observe=header.observe,
            visual=drawn,
            planner_visual=header.visual,
            patches=arm.patches if config.patches else (),
            settings=replace(config, visual=foreign, allow_mismatch=header.visual is not None and foreign is not None),
            privileged=privileged_inputs(header.observe),
            planners=tuple(str(each.path) for each in planners.planners),
            planner_sha256=planners.sha256,
            planner_seed=header.seed,
            command=running_command(),
            versions=installed(),
        )
        return cls(result, planners.paths, planners.cameras, header.image_size)

    def filming(self, out: Path, seeds: Sequence[int]) -> Self:
        """The same with the episodes of some seeds recorded, in a folder beside the result file."""
        return replace(self, videos=out.with_suffix("").absolute(), filmed=tuple(seeds))

    def video(self, seed: int) -> Path | None:
        """The file that an episode is recorded to, or None if it is not recorded."""
        return self.videos / f"episode_{seed}.mp4" if self.videos is not None and seed in self.filmed else None


class EpisodeRunner:
    """Runs the episodes of a transfer in one process, with the environment made and the planners loaded.

    Args:
        setup: what to run.

    Attributes:
        env: the environment.
    """

    def __init__(self, setup: TransferSetup) -> None:
        result = setup.result
        self._setup, self._settings = setup, result.settings
        self._planners = TaskPlanners.of(setup.planners).by_object
        self.env = make_env(
            result.task,
            result.robot,
            cameras=setup.cameras,
            image_size=setup.image_size,
            visual=result.visual or "fast",
            observe=result.observe,
            patches=result.patches,
            control=result.settings.control_loop,
        )

    def run(self, seed: int, on_step: Callable[[], None] | None = None) -> Episode:
        """Run one episode and keep its trace.

        Args:
            seed: seed of the reset.
            on_step: called after every control step.
        """
        settings = self._settings
        return run_episode(
            self.env,
            self._planners,
            seed,
            settings.control,
            observe=NoisyMask(settings.mask_error, seed).observe,
            pose_error=settings.pose_error,
            pose_filter=settings.pose_filter,
            on_step=on_step,
        )

    def play(self, seed: int) -> EpisodeResult:
        """Run one episode, and record it if its seed is among those filmed."""
        video = self._setup.video(seed)
        recorder = None if video is None else Recorder(self.env)
        episode = self.run(seed, recorder)
        if recorder is not None and video is not None:
            recorder.write(video, episode)
        return EpisodeResult(
            seed, episode.success, episode.steps, episode.failure, episode.released_by, episode.failed_with
        )

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()


def _preset(planners: TaskPlanners, config: TransferConfig) -> str:
    """The visual preset to draw with: the planner's own, unless a mismatch is allowed."""
    frequency = planners.header.control_freq
    if frequency != CONTROL_HZ:
        raise MismatchError(
            f"{planners} was trained on demonstrations of {frequency:g} Hz, but plans are carried out at "
            f"{CONTROL_HZ:g} Hz; train a planner on demonstrations of {CONTROL_HZ:g} Hz"
        )
    trained, asked = planners.header.visual, config.visual
    wanted = asked or trained
    if wanted is None:
        raise MismatchError(
            f"{planners} does not say with which visual preset its images were drawn; "
            "name it with --visual (robosuite's own pictures are stock)"
        )
    name = visual_preset(wanted).name
    if trained is not None and name != trained and not config.allow_mismatch:
        raise MismatchError(
            f"{planners} was trained on the visual preset {trained}, not {name}; leave --visual out, train "
            f"a planner on images that `ocplanner render --visual {name}` draws, or add --allow-mismatch"
        )
    return name
