"""``ocplanner transfer``."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.envs.robots import ROBOTS
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.errors import InvalidValueError
from ocplanner.progress import counting_columns

if TYPE_CHECKING:
    from ocplanner.files.records.episode import EpisodeResult
    from ocplanner.zero_shot.result import TransferResult

_PLANNERS = Path("results/planners")
_MATRIX = Path("results/matrix.json")
_ROBOT = "Sawyer"


@dataclass(frozen=True)
class Transfer:
    """Solve a planner's task on a robot that never demonstrated it, or with --matrix every task on every robot.

    Stop it whenever you like: the same command goes on where it was.
    """

    planner: tuple[Path, ...] = ()
    """Planner file (.safetensors) or the run folder of its training; for a task with several objects one for each."""
    robot: str | None = None
    """The arm: Panda, Sawyer, UR5e, IIWA, Kinova3, Jaco or XArm7. Default: Sawyer."""
    task: str | None = None
    """The task; must be the planner's."""
    matrix: bool = False
    """Try every planner of --planners on every robot of --robots."""
    planners: tuple[Path, ...] = ()
    """With --matrix: planner files, one a task or an object of it, or folders. Default: results/planners."""
    planner_seed: int = 0
    """With --matrix: of the planners in a folder take those of this training seed."""
    robots: tuple[str, ...] = ()
    """With --matrix: the arms. Default: all seven."""
    episodes: int = 50
    """Episodes to run; with --matrix of each task on each robot."""
    seed_start: int = 10000
    """Seed of the first episode; the others follow."""
    follow: Literal["gated", "time", "open-loop"] = "gated"
    """Advance along the plan when the object is there, by time, or blindly by the plan's differences (the paper's)."""
    observe: Literal["full", "masked", "no-robot"] | None = None
    """What the planner sees; must be what it was trained on, which is the default. no-robot is privileged."""
    visual: Literal["fast", "stock"] | None = None
    """Visual preset; must be the one that the planner was trained on, which is the default."""
    allow_mismatch: bool = False
    """Draw with --visual although the planner was trained on another preset."""
    patches: bool = True
    """Apply the corrections that the robot's model needs; they are named in the result."""
    control: Literal["native", "stock"] = "native"
    """Who runs the control loop: stock is robosuite's own, slower, with the same torques."""
    mask_error: int = 0
    """Make the robot's mask wrong by so many pixels."""
    pose_noise: Annotated[str, tyro.conf.arg(metavar="MM,DEG")] = "0,0"
    """Make the object's pose wrong that grasping and following read: standard deviations of its position along each
    axis and of its angle about a random axis, drawn anew each control step."""
    pose_latency: Annotated[int, tyro.conf.arg(metavar="STEPS")] = 0
    """Make that pose so many control steps (0.05 s) old."""
    pose_filter: Annotated[int, tyro.conf.arg(metavar="STEPS")] = 1
    """Average that pose over so many control steps, in the hand's frame while it is closed; 1 takes it as it is."""
    workers: int = 1
    """Processes; the result does not depend on it."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Run the workers on a Ray cluster: HOST:PORT, 'auto', or 'local' for one on this machine."""
    videos: int = 0
    """Record so many of the first episodes as mp4; with --matrix so many successes and so many failures of each task on
    each robot."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Result file. Default: results/transfer/TASK_ROBOT_FOLLOW_OBSERVE_SEED.json, or results/matrix.json, whose cells
    are kept in results/matrix."""
    overwrite: bool = False
    """Replace the result file if it is there; of a matrix those of its cells that hold something else."""

    def run(self) -> None:
        """Transfer with a progress bar."""
        if self.matrix:
            self._run_matrix()
        else:
            self._run_one()

    def _run_one(self) -> None:
        from ocplanner.zero_shot.loop import describe, run_transfer, seeds_of
        from ocplanner.zero_shot.scenario import make_scenario
        from ocplanner.zero_shot.task_planners import TaskPlanners

        self._refuse(planners=self.planners, robots=self.robots, planner_seed=self.planner_seed)
        robot = robot_spec(self.robot or _ROBOT).name
        if not self.planner:
            raise InvalidValueError("no planner is given; name its file with --planner, or add --matrix")
        planner = TaskPlanners.of(self.planner)
        scenario = make_scenario(planner, robot, task=self.task, **self._conditions())
        out = self.out or Path("results/transfer") / describe(scenario, planner).file_name
        console = Console()
        with _episode_bar(console) as bar:
            result = run_transfer(
                scenario,
                planner,
                seeds_of(self.episodes, self.seed_start),
                workers=self.workers,
                ray=self.ray,
                out=out,
                overwrite=self.overwrite,
                videos=self.videos,
                on_episode=bar(robot, self.episodes),
            )
        console.print(str(result), soft_wrap=True)
        console.print(f"{out}", soft_wrap=True)

    def _run_matrix(self) -> None:
        from ocplanner.report.heat_map import write_heat_map
        from ocplanner.zero_shot.matrix import find_planners, transfer_matrix

        self._refuse(planner=self.planner, robot=self.robot, task=self.task)
        robots = [robot_spec(name).name for name in self.robots or ROBOTS]
        if not self.planners and not _PLANNERS.is_dir():
            raise InvalidValueError(
                f"there is no folder {_PLANNERS} here; name planner files with --planners, or run this in a clone of "
                "the repository"
            )
        planners = find_planners(self.planners or (_PLANNERS,), self.planner_seed)
        out, picture = self.out or _MATRIX, (self.out or _MATRIX).with_suffix(".png")
        console = Console()
        with _episode_bar(console) as bar:
            count: Callable[[EpisodeResult], None] = bar("", 0)
            number, total = 0, len(planners) * len(dict.fromkeys(robots))

            def begin(cell: "TransferResult") -> None:
                nonlocal count, number
                number += 1
                count = bar(f"{cell.task} on {cell.robot} ({number} of {total})", self.episodes)

            def finish(cell: "TransferResult") -> None:
                console.print(str(cell), soft_wrap=True)
                write_heat_map(out, picture)

            transfer_matrix(
                planners,
                robots,
                out=out,
                episodes=self.episodes,
                seed_start=self.seed_start,
                workers=self.workers,
                ray=self.ray,
                overwrite=self.overwrite,
                videos=self.videos,
                on_start=begin,
                on_episode=lambda run: count(run),
                on_cell=finish,
                **self._conditions(),
            )
        console.print(f"{out}, {picture}", soft_wrap=True)

    def _conditions(self) -> dict[str, Any]:
        from ocplanner.control.noisy_pose import parse_noise

        return {
            "follow": self.follow,
            "observe": self.observe,
            "visual": self.visual,
            "allow_mismatch": self.allow_mismatch,
            "patches": None if self.patches else (),
            "control": self.control,
            "mask_error": self.mask_error,
            "pose_noise": parse_noise(self.pose_noise),
            "pose_latency": self.pose_latency,
            "pose_filter": self.pose_filter,
        }

    def _refuse(self, **flags: Any) -> None:
        given = [f"--{name.replace('_', '-')}" for name, value in flags.items() if value]
        if given and self.matrix:
            raise InvalidValueError(
                f"{given[0]} does not go with --matrix, which tries all planners (--planners) on all robots (--robots)"
            )
        if given:
            raise InvalidValueError(f"{given[0]} goes with --matrix only; a single transfer has --planner and --robot")


@contextmanager
def _episode_bar(console: Console) -> Iterator[Callable[[str, int], Callable[[Any], None]]]:
    """Yields what begins a bar of so many episodes and returns what counts one; without a terminal each is a line."""
    with Progress(*counting_columns(), console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("")

        def begin(name: str, episodes: int) -> Callable[["EpisodeResult"], None]:
            successes = 0
            progress.reset(bar, total=episodes, description=name)

            def count(run: "EpisodeResult") -> None:
                nonlocal successes
                successes += run.success
                progress.update(bar, advance=1, description=f"{name}: {successes} succeeded")
                if not console.is_terminal:
                    ended = "success" if run.success else run.failure
                    where = "" if run.failed_with is None else f" with the {run.failed_with}"
                    console.print(f"seed {run.seed}: {ended}{where} ({run.steps} steps)")

            return count

        yield begin


COMMAND = Transfer
