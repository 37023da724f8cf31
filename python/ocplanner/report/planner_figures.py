"""Figures 5, 6 and 7 of the paper from a planner and the data set that it was trained on."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import Segment
from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.errors import DatasetError
from ocplanner.files.records.planner import PlannerHeader
from ocplanner.planner.compatibility import check_fit
from ocplanner.planner.frames import future, split
from ocplanner.planner.planner import Planner
from ocplanner.report.model_figures import distinct_names, write_model_figures
from ocplanner.report.overlays import plan_grid
from ocplanner.report.plots import latent_map
from ocplanner.report.segments import segment_figure

_SEGMENTS = 6


@dataclass(frozen=True)
class _Part:
    """One demonstration: name, kept steps, and the object's positions (T, 3), metres, and rotations (T, 3, 3)."""

    name: str
    segment: Segment
    positions: np.ndarray
    rotations: np.ndarray


def planner_figures(
    planner: Planner,
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
        demos: a data set rendered as the planner's was. The planner sees its images; the pictures beneath the plans are
            drawn anew from its states and show the whole robot.
        rows: demonstrations in the grid of plans.
        columns: moments of each demonstration, evenly spaced from grasp to release.
        demonstrations: number of demonstrations whose latents are mapped. If too few are held out, others join.
        size: side of the pictures, pixels.

    Returns:
        ``plans`` (Figures 5 and 6) and ``latents`` (Figure 7).

    Raises:
        MismatchError: the data set does not show the planner what it was trained to see.
        DatasetError: the data set lacks a camera, does not name its robot, or its object never moves.
    """
    check_fit(planner, demos)
    if not demos.robots:
        raise DatasetError(f"{demos.path} does not name its robot; give a data set that does")
    parts = _parts(planner.header, demos, max(rows, demonstrations))
    with make_env(demos.task_name, demos.robots[0], cameras=planner.header.cameras[:1]) as env:
        plans = _plan_grid(planner, demos, env, parts[:rows], columns, size)
    mapped = parts[:demonstrations]
    latents = [planner.encode(_images(planner, demos, part, np.arange(*part.segment[:2]))) for part in mapped]
    return {"plans": plans, "latents": latent_map(latents)}


def draw_planners(files: Sequence[Path], data: Sequence[Path], folder: Path) -> list[Path]:
    """Load planner files and write each one's figures and, once for each object, the frames that training keeps.

    Files in run folders are named after the folder. Each planner is drawn on the first data set that fits it.

    Raises:
        ModelFileError: a file is damaged.
        MismatchError: no data set fits a planner.
        DatasetError: a data set is damaged, or the object of a planner never moves in it.
    """
    names = distinct_names(files, [planner_name(file) for file in files])
    objects: set[str] = set()

    def draw(name: str, planner: Planner, demos: Demonstrations) -> Mapping[str, Figure]:
        figures = {f"{kind}_{name}": figure for kind, figure in planner_figures(planner, demos).items()}
        if planner.header.object not in objects:
            objects.add(planner.header.object)
            kept = [part.name for part in _parts(planner.header, demos, _SEGMENTS)]
            figures[f"segments_{planner.header.object}"] = segment_figure(demos, kept, planner.header.object)
        return figures

    return write_model_figures(dict(zip(names, map(Planner.load, files))), data, folder, check_fit, draw)


def planner_name(file: Path) -> str:
    """``planner.safetensors`` goes by its folder's name, other files by their own."""
    return file.resolve().parent.name if file.stem == "planner" else file.stem


def _parts(header: PlannerHeader, demos: Demonstrations, most: int) -> list[_Part]:
    """At most so many demonstrations, held-out ones first, without those that training leaves out."""
    names = split(demos, header.seed or 0)
    parts = []
    for name in [*names.valid, *names.train]:
        with suppress(DatasetError):
            segment = demos[name].manipulation(header.object)
            parts.append(_Part(name, segment, *demos[name].object_poses(header.object)))
        if len(parts) == most:
            break
    if not parts:
        raise DatasetError(f"{demos.path}: {header.object} is manipulated in none of the demonstrations")
    return parts


def _plan_grid(
    planner: Planner, demos: Demonstrations, env: ManipulationEnv, parts: Sequence[_Part], columns: int, size: int
) -> Figure:
    camera, horizon = planner.header.cameras[0], planner.header.horizon
    pictures, planned, true, titles = [], [], [], []
    for part in parts:
        rows = np.array(part.segment.rows)
        shown = np.linspace(0, len(rows) - 1, columns + 1)[:-1].round().astype(int)
        steps = rows[shown]
        positions = planner.plan(_images(planner, demos, part, steps)).position
        follows = future(part.positions, part.rotations, rows, horizon).positions[shown]
        states = demos[part.name].states
        for step, plan, recorded in zip(steps, positions, follows):
            env.set_state(states[step])
            pictures.append(env.render(camera, size, size))
            planned.append(env.project(camera, plan, size, size))
            true.append(env.project(camera, recorded, size, size))
            titles.append(f"{part.name}, step {step}")
    title = f"Planned and true object trajectories, {horizon} steps ahead"
    return plan_grid(pictures, planned, true, titles=titles, columns=columns, title=title)


def _images(planner: Planner, demos: Demonstrations, part: _Part, steps: np.ndarray) -> dict[str, np.ndarray]:
    return {camera: demos[part.name].images(camera, steps) for camera in planner.header.cameras}
