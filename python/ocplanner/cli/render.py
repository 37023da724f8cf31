"""``ocplanner render``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import Progress

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.frames import RenderSettings
from ocplanner.demos.render import render_dataset
from ocplanner.envs.observation import Observe
from ocplanner.progress import counting_columns


@dataclass(frozen=True)
class Render:
    """Add camera images to a data set that has states.

    Stop it whenever you like: the same command goes on where it was.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")]
    """robomimic data set with states."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TARGET")]
    """File to make: a copy with images."""
    observe: Observe = "masked"
    """What the images show: everything, the robot painted flat, or no robot at all."""
    cameras: tuple[str, ...] = ("agentview",)
    """Cameras to render."""
    size: int = 84
    """Width and height, pixels."""
    visual: Literal["fast", "stock"] = "fast"
    """Visual preset: lean pictures, or robosuite's own."""
    silhouettes: tuple[str, ...] | None = None
    """Arms whose masks are added to masked images, for augmentation. Default: IIWA and Kinova3."""
    silhouette_stride: int = 1
    """Draw silhouettes for every so many-th frame only."""
    frames: Literal["all", "manipulation"] = "all"
    """Render all frames, or only those in which the robot manipulates the object."""
    workers: int = 2
    """Processes."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Run the workers on a Ray cluster: HOST:PORT, 'auto', or 'local' for one on this machine."""
    limit: int | None = None
    """Render the first so many demonstrations only."""
    overwrite: bool = False
    """Replace the target if it is there."""

    def run(self) -> None:
        """Render with a progress bar."""
        silhouettes = self.silhouettes
        if silhouettes is None:
            silhouettes = ("IIWA", "Kinova3") if self.observe == "masked" else ()
        settings = RenderSettings(
            observe=self.observe,
            cameras=self.cameras,
            size=self.size,
            visual=self.visual,
            silhouettes=silhouettes,
            silhouette_stride=self.silhouette_stride,
            frames=self.frames,
        )
        with Demonstrations(self.source) as demos:
            total = len(demos.names[: self.limit])
        console = Console(stderr=True)
        columns = counting_columns("demonstrations, {task.fields[rate]} steps/s")
        with Progress(*columns, console=console) as bar:
            line = bar.add_task("rendering", total=total, rate="-")
            steps = 0

            def advance(_: str, length: int) -> None:
                nonlocal steps
                steps += length
                elapsed = bar.tasks[line].elapsed or 0.0
                bar.update(line, advance=1, rate=f"{steps / elapsed:.0f}" if elapsed > 1 else "-")

            path = render_dataset(
                self.source,
                self.target,
                settings,
                workers=self.workers,
                ray=self.ray,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
            )
        console.print(f"wrote {path}: {total} demonstrations, {', '.join(self.cameras)}, observe={self.observe}")


COMMAND = Render
