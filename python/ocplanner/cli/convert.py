"""``ocplanner convert``."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from ocplanner.demos.convert import DEFAULT_CONVERSION, ConvertSettings
from ocplanner.demos.lerobot import DEFAULT_LEROBOT, LeRobotSettings
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.progress import demonstrations_bar
from ocplanner.settings import require


@dataclass(frozen=True)
class Convert:
    """Write demonstrations in another layout, for other tools: robomimic's HDF5 (version 1.5), or LeRobot's format v3.

    The other verbs read every HDF5 file as it is, and need no conversion. You can stop it at any time; the same command
    continues where it stopped (to LeRobot: begins anew).
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")]
    """HDF5 data set, or the folder of a LeRobot data set."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TARGET")]
    """File to make; with --to lerobot, folder."""
    to: Literal["robomimic", "lerobot"] = "robomimic"
    """The layout."""
    settings: Annotated[ConvertSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_CONVERSION
    reading: Annotated[ReadSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_READING
    """How an HDF5 source is read."""
    lerobot: Annotated[LeRobotSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_LEROBOT
    """Of --to lerobot only."""
    lerobot_python: Path | None = None
    """Python of an environment that has lerobot 0.4 or later, which cannot be installed beside robosuite."""
    limit: int | None = None
    """Convert the first so many demonstrations only."""
    overwrite: bool = False
    """Replace the target if it exists."""

    def run(self) -> None:
        """Convert with a progress bar."""
        from ocplanner.demos.convert import convert_dataset
        from ocplanner.demos.dataset import Demonstrations
        from ocplanner.demos.lerobot import episodes, from_lerobot, to_lerobot

        reads, writes = self.source.is_dir(), self.to == "lerobot"
        require(not (reads and writes), f"{self.source} is a folder, not an HDF5 file; leave out --to lerobot")
        require(writes or self.lerobot == DEFAULT_LEROBOT, f"only --to lerobot has {_flags(self.lerobot)}")
        require(reads or writes or self.lerobot_python is None, "--lerobot-python is of no use from HDF5 to HDF5")
        require(not reads or self.reading == DEFAULT_READING, "--skip-bad and --keys are of no use from LeRobot")
        if reads:
            total, convert = episodes(self.source), partial(from_lerobot, python=self.lerobot_python)
        else:
            with Demonstrations(self.source, reading=self.reading) as demos:
                total = len(demos)
            convert = partial(convert_dataset, reading=self.reading)
            if writes:
                convert = partial(to_lerobot, settings=self.lerobot, reading=self.reading, python=self.lerobot_python)
        total = total if self.limit is None else min(total, self.limit)
        console = Console(stderr=True)
        with demonstrations_bar("converting", total, console) as advance:
            path = convert(
                self.source,
                self.target,
                conversion=self.settings,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
                say=partial(console.print, markup=False),
            )
        if writes:
            total = episodes(path)
        else:
            with Demonstrations(path) as made:
                total = len(made)
        console.print(f"wrote {path}: {total} demonstration{'s' * (total != 1)}", markup=False)


def _flags(settings: LeRobotSettings) -> str:
    """The flags that were given."""
    given = [name for name, value in vars(settings).items() if value != getattr(DEFAULT_LEROBOT, name)]
    return ", ".join(f"--{name.replace('_', '-')}" for name in given)


COMMAND = Convert
