"""The verb ``report``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Report:
    """Build one self-contained HTML page from run folders, transfer results, videos and figures."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders, result files, planner files, or folders that hold any of them."""
    out: Path = Path("report.html")
    """The page to write."""
    data: Path | None = None
    """Rendered data set: draw each planner's plans on its held-out demonstrations, in figures/ beside the page."""
    charts: Path | None = None
    """Folder for the charts as SVG and PNG files too."""
    title: str | None = None
    """Title of the page; by default the task and the robots."""
    most_videos: int = 12
    """Videos embedded at most."""

    def run(self) -> None:
        """Write the page and print its path."""
        from ocplanner.report.figures import write_figures
        from ocplanner.report.page import write_page
        from ocplanner.report.planner_figures import draw_planners
        from ocplanner.report.sources import find_sources

        sources = find_sources(self.paths)
        if self.data is not None:
            drawn = draw_planners(sources.planners, self.data, self.out.parent / "figures")
            sources = find_sources([*self.paths, *drawn])
        if self.charts is not None:
            write_figures(sources, self.charts)
        page = write_page(sources, self.out, title=self.title, most_videos=self.most_videos)
        sys.stdout.write(f"{page} ({page.stat().st_size / 1e6:.1f} MB)\n")


COMMAND = Report
