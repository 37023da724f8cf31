"""``ocplanner transfer``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.envs.robots import robot as robot_spec
from ocplanner.progress import counting_columns


@dataclass(frozen=True)
class Transfer:
    """Solve a planner's task on a robot that never demonstrated it.

    Stop it whenever you like: the same command goes on where it was.
    """

    planner: Path
    """Planner file (.safetensors)."""
    robot: str = "Sawyer"
    """The arm: Panda, Sawyer, UR5e, IIWA, Kinova3, Jaco or XArm7."""
    task: str | None = None
    """The task; must be the planner's."""
    episodes: int = 50
    """Episodes to run."""
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
    workers: int = 1
    """Processes; the result does not depend on it."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Run the workers on a Ray cluster: HOST:PORT, 'auto', or 'local' for one on this machine."""
    videos: int = 0
    """Record so many of the first episodes as mp4."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Result file. Default: results/transfer/TASK_ROBOT_FOLLOW_OBSERVE_SEED.json."""
    overwrite: bool = False
    """Replace the result file if it is there."""

    def run(self) -> None:
        """Transfer with a progress bar."""
        from ocplanner.planner.planner import Planner
        from ocplanner.transfer.loop import result_path, transfer
        from ocplanner.transfer.result import Run

        robot_spec(self.robot)
        planner = Planner.load(self.planner)
        out = self.out or result_path(planner, self.robot, self.follow, self.mask_error, self.visual)
        console = Console()
        with Progress(*counting_columns(), console=console, disable=not console.is_terminal) as progress:
            bar = progress.add_task(self.robot, total=self.episodes)
            successes = 0

            def count(run: Run) -> None:
                nonlocal successes
                successes += run.success
                progress.update(bar, advance=1, description=f"{self.robot}: {successes} succeeded")
                if not console.is_terminal:
                    console.print(f"seed {run.seed}: {'success' if run.success else run.failure} ({run.steps} steps)")

            result = transfer(
                planner,
                self.robot,
                task=self.task,
                episodes=self.episodes,
                seed_start=self.seed_start,
                follow=self.follow,
                observe=self.observe,
                visual=self.visual,
                allow_mismatch=self.allow_mismatch,
                patches=None if self.patches else (),
                control=self.control,
                mask_error=self.mask_error,
                workers=self.workers,
                ray=self.ray,
                out=out,
                overwrite=self.overwrite,
                videos=self.videos,
                on_episode=count,
            )
        console.print(str(result), soft_wrap=True)
        console.print(f"{out}", soft_wrap=True)


COMMAND = Transfer
