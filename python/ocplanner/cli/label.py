"""The verb ``label``."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.guidance.settings import LabelSettings
from ocplanner.progress import demonstrations_bar

_DEFAULTS = LabelSettings()


@dataclass(frozen=True)
class Label:
    """Write a planner's hints and dense rewards into a copy of a data set with images.

    You can stop it at any time; run the same command again to continue.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DATA")]
    """robomimic data set with the images that the planner was trained on, unless --pictures has them."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")]
    """File to make: a copy with labels."""
    planner: Path
    """Planner file (.safetensors)."""
    pictures: Path | None = None
    """Another rendering of the same demonstrations, drawn as the planner was trained."""
    settings: Annotated[LabelSettings, tyro.conf.arg(name="")] = _DEFAULTS
    """What is written."""
    reading: Annotated[ReadSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_READING
    limit: int | None = None
    """Label only the first so many demonstrations."""
    overwrite: bool = False
    """Replace the target if it exists."""

    def run(self) -> None:
        """Label with a progress bar."""
        from ocplanner.demos.dataset import Demonstrations
        from ocplanner.guidance.dataset import label_dataset
        from ocplanner.planner.planner import Planner

        planner = Planner.load(self.planner)
        with Demonstrations(self.source, reading=self.reading) as demos:
            total = len(demos.names[: self.limit])
        console = Console(stderr=True)
        with demonstrations_bar("labelling", total, console) as advance:
            path = label_dataset(
                self.source,
                self.target,
                planner,
                self.settings,
                pictures=self.pictures,
                reading=self.reading,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
                say=partial(console.print, markup=False),
            )
        with Demonstrations(path) as made:
            total = len(made)
        hints, reward = self.settings.hints, self.settings.reward
        written = [*(["hints"] if hints else []), *([f"rewards ({reward})"] if reward != "off" else [])]
        console.print(
            f"wrote {path}: {total} demonstration{'s' * (total != 1)} with {' and '.join(written)}", markup=False
        )


COMMAND = Label
