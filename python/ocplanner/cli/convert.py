"""``ocplanner convert``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ocplanner.demos.convert import DEFAULT_CONVERSION, ConvertSettings
from ocplanner.progress import demonstrations_bar


@dataclass(frozen=True)
class Convert:
    """Write any file of demonstrations as a robomimic data set (layout of version 1.5) for other tools.

    The verbs of ocplanner read every file as it is and need no conversion. You can stop it at any time; the same
    command continues where it stopped.
    """

    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")]
    """Data set."""
    target: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TARGET")]
    """File to make."""
    settings: Annotated[ConvertSettings, tyro.conf.OmitArgPrefixes] = DEFAULT_CONVERSION
    limit: int | None = None
    """Convert the first so many demonstrations only."""
    overwrite: bool = False
    """Replace the target if it exists."""

    def run(self) -> None:
        """Convert with a progress bar."""
        from ocplanner.demos.convert import convert_dataset
        from ocplanner.demos.dataset import Demonstrations

        with Demonstrations(self.source) as demos:
            total = len(demos.names[: self.limit])
        console = Console(stderr=True)
        with demonstrations_bar("converting", total, console) as advance:
            path = convert_dataset(
                self.source,
                self.target,
                self.settings,
                limit=self.limit,
                overwrite=self.overwrite,
                progress=advance,
                say=lambda line: console.print(line, markup=False),
            )
        console.print(f"wrote {path}: {total} demonstration{'s' * (total != 1)}")


COMMAND = Convert
