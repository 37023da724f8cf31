"""``ocplanner render``."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ocplanner.collection.settings import RenderSettings
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.progress import demonstrations_bar
from ocplanner.rollouts.settings import WorkerSettings


@dataclass(frozen=True)
class Render:
    """Add camera images to a data set that has states.

    You can stop it at any time; the same command continues where it stopped.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")]
    """Data set with states: robomimic's, or a raw recording of robosuite's."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TARGET")]
    """File to make: a copy with images."""
    settings: Annotated[RenderSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=RenderSettings)
    workers: Annotated[WorkerSettings, tyro.conf.OmitArgPrefixes] = field(default_factory=lambda: WorkerSettings(2))
    reading: Annotated[ReadSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_READING
    limit: int | None = None
    """Render the first so many demonstrations only."""
    overwrite: bool = False
    """Replace the target if it exists."""

    def run(self) -> None:
        """Render with a progress bar."""
        from ocplanner.collection.render import render_dataset
        from ocplanner.demos.dataset import Demonstrations

        with Demonstrations(self.source, reading=self.reading) as demos:
            total = len(demos.names[: self.limit])
        console, settings = Console(stderr=True), self.settings
        with demonstrations_bar("rendering", total, console) as advance:
            path = render_dataset(
                self.source,
                self.target,
                settings,
                self.workers,
                reading=self.reading,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
                say=partial(console.print, markup=False),
            )
        with Demonstrations(path) as made:
            total = len(made)
        line = f"wrote {path}: {total} demonstrations, {', '.join(settings.cameras)}, observe={settings.observe}"
        console.print(line, markup=False)


COMMAND = Render
