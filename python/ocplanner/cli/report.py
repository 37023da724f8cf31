"""The verb ``report``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ocplanner.errors import ResultFileError
from ocplanner.files.storage import check_output

if TYPE_CHECKING:
    from ocplanner.report.sources import Sources


@dataclass(frozen=True)
class Report:
    """Build one self-contained HTML page from run folders, results of transfers and evaluations, videos and figures."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders, result files, planner and policy files, or folders that hold any of them."""
    out: Path = Path("report.html")
    """The page to write."""
    data: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Data set: draw each planner's plans, and what each policy makes of its hint, on held-out demonstrations, in
    figures/ beside the page. Planners need a rendered one, policies one labelled as theirs was; may be repeated."""
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
        from ocplanner.report.sources import find_sources

        sources = find_sources(self.paths)
        check_output(self.out, True, "HTML page", (*sources.files, *self.data))
        if self.data:
            sources = find_sources([*self.paths, *self._draw(sources)])
        if self.charts is not None:
            write_figures(sources, self.charts)
        page = write_page(sources, self.out, title=self.title, most_videos=self.most_videos)
        sys.stdout.write(f"{page} ({page.stat().st_size / 1e6:.1f} MB)\n")

    def _draw(self, sources: "Sources") -> list[Path]:
        from ocplanner.report.planner_figures import draw_planners
        from ocplanner.report.policy_figures import draw_policies

        folder = self.out.parent / "figures"
        drawn = draw_planners(sources.planners, self.data, folder) if sources.planners else []
        drawn += draw_policies(sources.policies, self.data, folder)
        if not drawn:
            raise ResultFileError(
                f"--data is given, but {', '.join(map(str, self.paths))} holds no planner and no policy with a hint to "
                "draw on it; leave --data out, or name a planner or policy file (.safetensors)"
            )
        return drawn


COMMAND = Report
