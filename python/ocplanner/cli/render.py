"""``ocplanner render``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from ocplanner.envs.visuals import Observe
from ocplanner.progress import demonstrations_bar


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
        from ocplanner.collection.frames import RenderSettings
        from ocplanner.collection.render import render_dataset
        from ocplanner.demos.dataset import Demonstrations

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
        with demonstrations_bar("rendering", total, console) as advance:
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
