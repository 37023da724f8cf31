"""Pictures of demonstrations: the object's paths over the scene, and one moment in every observation mode."""

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import new_figure, styled
from ocplanner.envs import make_env
from ocplanner.envs.visuals import OBSERVE_MODES
from ocplanner.errors import InvalidValueError
from ocplanner.report.overlays import film_strip, show_image


def paths_figure(
    demos: Demonstrations, names: Sequence[str] | None = None, *, camera: str = "agentview", size: int = 512
) -> Figure:
    """Draw the object's kept path in each demonstration over the scene without the robot, coloured by time.

    Args:
        demos: a data set with states.
        names: the demonstrations to draw; all if None.
        camera: name of the camera.
        size: side of the picture, pixels.

    Raises:
        InvalidValueError: no demonstration was named.
        DatasetError: a demonstration is not there, or holds no manipulation.
    """
    names = demos.names if names is None else names
    if not names:
        raise InvalidValueError("no demonstration named; name at least one to draw")
    with make_env(demos.task_name, demos.robots[0], cameras=()) as env:
        env.set_state(demos[names[0]].states[0])
        picture = env.render(camera, size, size, observe="no-robot")
        paths = [env.project(camera, _kept_path(demos, name), size, size) for name in names]
    with styled():
        figure = new_figure(5.4, 5.2)
        axes = figure.subplots()
        show_image(axes, picture)
        for path in paths:
            steps = np.stack([path[:-1], path[1:]], axis=1)
            lines = LineCollection(list(steps), array=np.linspace(0, 1, len(steps)), cmap="viridis", linewidths=1.6)
            lines.set_alpha(0.85)
            axes.add_collection(lines)
        bar = figure.colorbar(
            axes.collections[0], ax=axes, ticks=[0, 1], orientation="horizontal", shrink=0.5, pad=0.01
        )
        bar.ax.set_xticklabels(["grasp", "release"])
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    return figure


def observations_figure(
    demos: Demonstrations, name: str, step: int, *, camera: str = "agentview", size: int = 256
) -> Figure:
    """Draw one recorded moment as planners of each observation mode see it.

    Args:
        demos: a data set with states.
        name: name of the demonstration.
        step: its step.
        camera: name of the camera.
        size: side of each picture, pixels.

    Raises:
        InvalidValueError: the demonstration has no such step.
        DatasetError: the demonstration is not there.
    """
    states = demos[name].states
    if not 0 <= step < len(states):
        raise InvalidValueError(f"{name} has steps 0 to {len(states) - 1}, not {step}")
    with make_env(demos.task_name, demos.robots[0], cameras=()) as env:
        env.set_state(states[step])
        pictures = [env.render(camera, size, size, observe=mode) for mode in OBSERVE_MODES]
    return film_strip(pictures, titles=list(OBSERVE_MODES))


def _kept_path(demos: Demonstrations, name: str) -> np.ndarray:
    demo = demos[name]
    positions, _ = demo.object_poses(demo.object_names[0])
    return positions[list(demo.manipulation().rows)]
