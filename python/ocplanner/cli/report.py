"""``ocplanner report``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Report:
    """Build one self-contained HTML page from run folders, transfer results, videos and figures."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders, result files, or folders that hold any of them."""
    out: Path = Path("report.html")
    """The page to write."""
    title: str | None = None
    """Title of the page; by default the task and the robots."""
    most_videos: int = 12
    """Videos embedded at most."""

    def run(self) -> None:
        """Write the page and print its path."""
        from ocplanner.report.page import write_report

        out = write_report(self.paths, self.out, title=self.title, most_videos=self.most_videos)
        size = out.stat().st_size / 1e6
        sys.stdout.write(f"{out} ({size:.1f} MB)\n")


COMMAND = Report
