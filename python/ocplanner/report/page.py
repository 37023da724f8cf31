"""One self-contained HTML page of runs and results: no script, no network, light and dark."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import yaml
from markupsafe import Markup

from ocplanner.drawing.style import SERIES, page_colors, page_svg
from ocplanner.files.records.evaluation import PolicyResult
from ocplanner.files.records.metrics import HeldOutErrors
from ocplanner.files.storage import atomic_write, check_output
from ocplanner.report.heat_map import cell_text, heat_map
from ocplanner.report.media import EmbeddedVideo, embed_file, embed_video
from ocplanner.report.noise_plot import noise_series, success_against_noise
from ocplanner.report.plots import ERRORS, LOSSES, curve_panel
from ocplanner.report.policy_section import policy_section
from ocplanner.report.results import TransferGroup, failure_classes, group_results
from ocplanner.report.runs import TrainingRun, run_labels
from ocplanner.report.sources import Sources, find_sources
from ocplanner.zero_shot.result import TransferResult

FIGURE_CAPTIONS = {
    "plans": "Planned (red) and true (cyan) object trajectories over the camera image, on held-out demonstrations.",
    "latents": "Latent plans along demonstrations, by t-SNE; the colour is the time from grasp to release.",
    "hint_use": "How a policy uses the hint along a recorded demonstration, in its most likely mode.",
    "hint_share": "The hint's share of the motion while the object is held; the rest is the residual's.",
    "segments": "The frames of demonstrations that training keeps: from grasp to release.",
}
"""Captions of the package's own figures, by the beginning of their file names."""

_OF_HINTS = ("hint_use", "hint_share")
_DRAWN_HERE = (
    "loss_curves",
    "policy_curves",
    "success_curves",
    "error_curves",
    "success_rates",
    "failure_matrix",
    "heat_map",
    "pose_noise",
    "film_strip",
)


@dataclass(frozen=True)
class _Training:
    """One run on the page."""

    run: TrainingRun
    label: str
    color: int
    held_out: list[HeldOutErrors]


def write_report(
    paths: Sequence[str | Path], out: str | Path, *, title: str | None = None, most_videos: int = 12
) -> Path:
    """Collect what is in ``paths`` and write the page.

    Args:
        paths: run folders, result files, videos, or folders with any of them.
        out: the page; it appears whole or not at all.
        title: title of the page; by default the tasks and the robots.
        most_videos: most videos to embed; half of them show failures if there are enough.

    Raises:
        ResultFileError: a path is missing or damaged, or there is nothing to show.
        OutputError: the page cannot be written.
    """
    return write_page(find_sources(paths), out, title=title, most_videos=most_videos)


def write_page(sources: Sources, out: str | Path, *, title: str | None = None, most_videos: int = 12) -> Path:
    """:func:`write_report` for sources found already."""
    out = Path(out)
    check_output(out, True, "HTML page", sources.files)
    text = render_page(sources, title=title, most_videos=most_videos)
    with atomic_write(out) as partial:
        partial.write_text(text, encoding="utf-8")
    return out


def render_page(sources: Sources, *, title: str | None = None, most_videos: int = 12) -> str:
    """The page as HTML."""
    groups = sorted(group_results(sources.records), key=_rank)
    videos = [embed_video(path, sources.records) for path in sources.videos]
    shown = _pick(videos, most_videos)
    figures = _figures(sources.figures)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ocplanner.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=title or _title(sources),
        colors=page_colors(),
        groups=groups,
        heat_map=heat_map(groups),
        cell_text=cell_text,
        noise_panels=_noise_panels(sources.records),
        classes=failure_classes(groups),
        most_failures=max((max(group.failures.values(), default=0) for group in groups), default=0),
        records=sources.records,
        videos=shown,
        videos_left_out=len(videos) - len(shown),
        strips=_strips(shown),
        figures=[figure for figure in figures if not figure["name"].startswith(_OF_HINTS)],
        hint_figures=[figure for figure in figures if figure["name"].startswith(_OF_HINTS)],
        policies=policy_section(sources),
        trainings=_trainings(sources.planner_runs),
        panels=_panels(sources.planner_runs),
        configurations=[(run.name, yaml.safe_dump(run.config.to_yaml(), sort_keys=False)) for run in sources.runs],
        commands=list(dict.fromkeys(record.command for record in _results(sources) if record.command)),
        versions=_versions(sources),
        planners=_planners(groups),
        patches=_patches(groups),
    )


def _results(sources: Sources) -> list[TransferResult | PolicyResult]:
    return [*sources.records, *(record.result for record in sources.evaluations)]


def _rank(group: TransferGroup) -> tuple[Any, ...]:
    """The package's defaults first, then their alternatives."""
    first = group.records[0]
    follow, observe = ("gated", "time", "open-loop"), ("masked", "no-robot", "full")
    return (
        follow.index(first.settings.control.follow),
        observe.index(first.observe) if first.observe in observe else len(observe),
        first.settings.mask_error,
    )


def _title(sources: Sources) -> str:
    results = sources.records or [record.result for record in sources.evaluations]
    tasks = list(dict.fromkeys(result.task for result in results))
    robots = list(dict.fromkeys(result.robot for result in results))
    if not tasks:
        return "Planner training" if sources.planner_runs else "Policy training" if sources.runs else "ocplanner report"
    return f"{'' if sources.records else 'Policies: '}{_enumerated(tasks)} on {_enumerated(robots)}"


def _enumerated(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _pick(videos: list[EmbeddedVideo], most: int) -> list[EmbeddedVideo]:
    """At most ``most`` videos in their old order: half of them successes and half failures, if there are enough."""
    good = [i for i, video in enumerate(videos) if video.episode is None or video.episode.success]
    bad = [i for i, video in enumerate(videos) if i not in set(good)]
    failures = min(len(bad), max(most // 2, most - len(good)))
    return [videos[i] for i in sorted(good[: most - failures] + bad[:failures])]


def _strips(videos: list[EmbeddedVideo]) -> list[EmbeddedVideo]:
    """The first success and the first failure."""
    first = {}
    for video in videos:
        first.setdefault(video.episode is None or video.episode.success, video)
    return list(first.values())


def _figures(paths: Sequence[Path]) -> list[dict[str, str]]:
    """Pictures to embed, known kinds first. A picture in two formats counts once, and so do equal pictures."""
    known = list(FIGURE_CAPTIONS)

    def kind(path: Path) -> int:
        return next((i for i, name in enumerate(known) if path.stem.startswith(name)), len(known))

    one_a_stem = list({path.with_suffix(""): path for path in reversed(paths)}.values())[::-1]
    shown = {}
    for path in sorted(one_a_stem, key=kind):
        if not path.stem.startswith(_DRAWN_HERE):
            caption = [*FIGURE_CAPTIONS.values(), path.stem.replace("_", " ").capitalize() + "."][kind(path)]
            uri = embed_file(path)
            shown.setdefault(uri, {"uri": uri, "caption": caption, "name": path.stem})
    return list(shown.values())


def _trainings(runs: Sequence[TrainingRun]) -> list[_Training]:
    return [
        _Training(run, label, i % len(SERIES), run.held_out())
        for i, (run, label) in enumerate(zip(runs, run_labels(runs)))
    ]


def _panels(runs: Sequence[TrainingRun]) -> list[Markup]:
    wanted = [(stage, "valid_loss", title) for stage, title in LOSSES]
    wanted += [("predictor", value, title) for value, title in ERRORS]
    drawn = [
        (stage, value, title) for stage, value, title in wanted if any(len(run.series(stage, value)[0]) for run in runs)
    ]
    return [
        Markup(page_svg(curve_panel(runs, stage, value, title), f"panel{i}"))  # noqa: S704 drawn and escaped by matplotlib
        for i, (stage, value, title) in enumerate(drawn)
    ]


def _noise_panels(records: Sequence[TransferResult]) -> list[Markup]:
    return [
        Markup(page_svg(success_against_noise(series), f"noise{i}"))  # noqa: S704 drawn and escaped by matplotlib
        for i, series in enumerate(noise_series(records))
    ]


def _versions(sources: Sources) -> dict[str, str]:
    """Package -> versions; several if results differ."""
    found: dict[str, list[str]] = {}
    for record in _results(sources):
        for package, version in record.versions.items():
            if version not in found.setdefault(package, []):
                found[package].append(version)
    return {package: ", ".join(versions) for package, versions in sorted(found.items())}


def _patches(groups: Sequence[TransferGroup]) -> dict[str, str]:
    """Patch -> robots that have it."""
    with_patch: dict[str, list[str]] = {}
    for group in groups:
        for patch in group.records[0].patches:
            with_patch.setdefault(patch, []).append(group.records[0].robot)
    return {patch: ", ".join(dict.fromkeys(robots)) for patch, robots in sorted(with_patch.items())}


def _planners(groups: Sequence[TransferGroup]) -> list[dict[str, Any]]:
    """SHA-256 -> transfers that used the planner."""
    used: dict[str, list[str]] = {}
    for group in groups:
        for record in group.records:
            if record.planner_sha256:
                used.setdefault(record.planner_sha256, []).append(record.title)
    return [{"sha256": sha256, "used": list(dict.fromkeys(titles))} for sha256, titles in used.items()]
