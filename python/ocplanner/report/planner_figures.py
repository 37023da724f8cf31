"""Figures 5, 6 and 7 of the paper from a planner and the data set it was trained on."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import Segment
from ocplanner.drawing.style import save_figure
from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.errors import DatasetError, MismatchError
from ocplanner.planner.frames import future, split
from ocplanner.report.fitting import first_fitting
from ocplanner.report.names import distinct_names
from ocplanner.report.overlays import plan_grid
from ocplanner.report.plots import latent_map
from ocplanner.report.segments import segment_figure

_SEGMENTS = 6


class PlansImages(Protocol):
    """What is asked of a planner here; :class:`ocplanner.planner.Planner` is one."""

    @property
    def config(self) -> Mapping[str, Any]:
        """The planner file's configuration."""
        ...

    def plan(self, images: dict[str, np.ndarray]) -> Any:
        """Camera name -> (B, h, w, 3) uint8 to a plan with ``position`` (B, H, 3), metres."""
        ...

    def encode(self, images: dict[str, np.ndarray]) -> np.ndarray:
        """Camera name -> (B, h, w, 3) uint8 to latents (B, latent)."""
        ...


@dataclass(frozen=True)
class _Part:
    """One held-out demonstration: its name, kept span, object path (T, 3) and rotations (T, 3, 3), metres."""

    name: str
    segment: Segment
    positions: np.ndarray
    rotations: np.ndarray


def planner_figures(
    planner: PlansImages,
    demos: Demonstrations,
    *,
    rows: int = 3,
    columns: int = 4,
    demonstrations: int = 10,
    size: int = 512,
) -> dict[str, Figure]:
    """Draw what a planner plans on held-out demonstrations.

    Args:
        planner: the planner.
        demos: a data set rendered as the planner's was; the images come from it, the pictures beneath the plans are
            drawn anew from its states, with the whole robot in view.
        rows: demonstrations in the grid of plans.
        columns: moments of each, evenly spaced from grasp to release.
        demonstrations: whose latents are mapped; demonstrations trained on fill up if too few are held out.
        size: side of the pictures, pixels.

    Returns:
        ``plans`` (Figures 5 and 6) and ``latents`` (Figure 7).

    Raises:
        MismatchError: the data set was rendered for another observation, or lacks a camera.
        DatasetError: the data set is damaged, or its object never moves.
    """
    _check(planner.config, demos)
    parts = _parts(planner.config, demos, max(rows, demonstrations))
    with make_env(demos.task_name, demos.robots[0], cameras=(planner.config["cameras"][0],)) as env:
        plans = _plan_grid(planner, demos, env, parts[:rows], columns, size)
    mapped = parts[:demonstrations]
    latents = [planner.encode(_images(planner.config, demos, part, _kept(part))) for part in mapped]
    return {"plans": plans, "latents": latent_map(latents)}


def kept_frames_figure(config: Mapping[str, Any], demos: Demonstrations) -> Figure:
    """The frames that training keeps of a few demonstrations: the same for every planner of one object and data set.

    Raises:
        DatasetError: the object of the planner's ``config`` is manipulated in none of the demonstrations.
    """
    return segment_figure(demos, [part.name for part in _parts(config, demos, _SEGMENTS)], config["object"])


def write_planner_figures(planner: PlansImages, demos: Demonstrations, folder: str | Path, name: str) -> list[Path]:
    """Write the figures of :func:`planner_figures` as ``folder/KIND_NAME.png`` and return their paths."""
    figures = planner_figures(planner, demos)
    return [save_figure(figure, Path(folder) / f"{kind}_{name}.png") for kind, figure in figures.items()]


def draw_planners(planners: Sequence[Path], data: Sequence[Path], folder: Path) -> list[Path]:
    """Load planner files and write each one's figures, and once for each object the frames kept of the data set.

    Files in run folders are named after the folder. Each planner is drawn on the first data set that fits it.

    Raises:
        ModelFileError: a file is damaged.
        MismatchError: no data set fits a planner.
        DatasetError: a data set is damaged.
    """
    from ocplanner.planner.planner import Planner

    names = distinct_names(planners, [planner_name(file) for file in planners])
    kept: dict[str, Path] = {}
    written = []
    with contextlib.ExitStack() as opened:
        sets = [opened.enter_context(Demonstrations(path)) for path in data]
        for file, name in zip(planners, names):
            planner = Planner.load(file)
            demos = first_fitting(sets, partial(_check, planner.config))
            written += write_planner_figures(planner, demos, folder, name)
            manipulated = str(planner.config["object"])
            if manipulated not in kept:
                figure = kept_frames_figure(planner.config, demos)
                kept[manipulated] = save_figure(figure, folder / f"segments_{manipulated}.png")
    return [*written, *kept.values()]


def planner_name(file: Path) -> str:
    """``planner.safetensors`` goes by its folder's name, other files by their own."""
    return file.resolve().parent.name if file.stem == "planner" else file.stem


def _check(config: Mapping[str, Any], demos: Demonstrations) -> None:
    missing = [camera for camera in config["cameras"] if camera not in demos.cameras]
    if missing:
        raise MismatchError(
            f"{demos.path} has no images of camera {', '.join(missing)}, which the planner sees through "
            f"(it has: {', '.join(demos.cameras) or 'none'}); add them with `ocplanner render`"
        )
    if demos.observe != config["observe"]:
        raise MismatchError(
            f"{demos.path} shows observe={demos.observe}, the planner was trained on {config['observe']}"
        )
    if demos.task_name != config["task"]:
        raise MismatchError(f"{demos.path} is of task {demos.task_name}, the planner of {config['task']}")
    if not demos.robots:
        raise DatasetError(f"{demos.path} does not say which robot it was recorded with")


def _parts(config: Mapping[str, Any], demos: Demonstrations, most: int) -> list[_Part]:
    """At most so many demonstrations, held-out ones first, without those that training leaves out."""
    names = split(demos, int(config["seed"]))
    parts = []
    for name in [*names.valid, *names.train]:
        positions, rotations = demos[name].object_poses(config["object"])
        with contextlib.suppress(DatasetError):
            segment = demos[name].manipulation(config["object"])
            parts.append(_Part(name, segment, positions, rotations))
        if len(parts) == most:
            break
    if not parts:
        raise DatasetError(f"{demos.path}: {config['object']} is manipulated in none of the demonstrations")
    return parts


def _plan_grid(
    planner: PlansImages, demos: Demonstrations, env: ManipulationEnv, parts: Sequence[_Part], columns: int, size: int
) -> Figure:
    camera, horizon = planner.config["cameras"][0], int(planner.config["horizon"])
    pictures, planned, true, titles = [], [], [], []
    for part in parts:
        steps = np.linspace(part.segment.start, part.segment.stop - 1, columns + 1)[:-1].round().astype(int)
        positions = planner.plan(_images(planner.config, demos, part, steps)).position
        span = (part.segment.start, part.segment.stop)
        follows = future(part.positions, part.rotations, *span, horizon).positions
        states = demos[part.name].states
        for step, plan in zip(steps, positions):
            env.set_state(states[step])
            pictures.append(env.render(camera, size, size))
            planned.append(env.project(camera, plan, size, size))
            true.append(env.project(camera, follows[step - part.segment.start], size, size))
            titles.append(f"{part.name}, step {step}")
    title = f"Planned and true object trajectories, {horizon} steps ahead"
    return plan_grid(pictures, planned, true, titles=titles, columns=columns, title=title)


def _kept(part: _Part) -> np.ndarray:
    return np.arange(part.segment.start, part.segment.stop)


def _images(config: Mapping[str, Any], demos: Demonstrations, part: _Part, steps: np.ndarray) -> dict[str, np.ndarray]:
    return {camera: demos[part.name].images(camera, steps) for camera in config["cameras"]}
