"""The charts of a report as files, for a paper or slides."""

from pathlib import Path

from ocplanner.drawing.style import save_figure
from ocplanner.drawing.video import read_video
from ocplanner.report.heat_map import draw_heat_map, heat_map
from ocplanner.report.model_figures import distinct_names
from ocplanner.report.noise_plot import noise_series, success_against_noise
from ocplanner.report.overlays import film_strip
from ocplanner.report.plots import error_curves, failure_matrix, loss_curves, success_rates
from ocplanner.report.policy_curves import policy_curves, success_curves
from ocplanner.report.policy_results import policy_cells
from ocplanner.report.results import group_results
from ocplanner.report.sources import Sources


def write_figures(sources: Sources, folder: str | Path) -> list[Path]:
    """Write all charts that the sources give as SVG and PNG, and a film strip of each video.

    Raises:
        ResultFileError: a video cannot be decoded.
        OutputError: a file cannot be written.
    """
    folder = Path(folder)
    charts = {}
    if sources.planner_runs:
        runs = sources.planner_runs
        charts |= {"loss_curves": loss_curves(runs), "error_curves": error_curves(runs)}
    if sources.policy_runs:
        charts["policy_curves"] = policy_curves(sources.policy_runs)
    if sources.evaluations:
        charts["success_curves"] = success_curves(policy_cells(sources.evaluations))
    if sources.records:
        groups = group_results(sources.records)
        charts |= {"success_rates": success_rates(groups), "failure_matrix": failure_matrix(groups)}
        if (table := heat_map(groups)).compares:
            charts["heat_map"] = draw_heat_map(table)
        series = noise_series(sources.records)
        charts |= {f"pose_noise_{i}": success_against_noise(records) for i, records in enumerate(series)}
    written = [
        save_figure(figure, folder / f"{name}.{kind}", sources.files)
        for name, figure in charts.items()
        for kind in ("svg", "png")
    ]
    written += [
        save_figure(film_strip(list(read_video(path))), folder / f"film_strip_{name}.png", sources.files)
        for path, name in zip(sources.videos, distinct_names(sources.videos))
    ]
    return written
