"""A plan's reward and a critic's value along episodes, good and bad ones side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import INK, MUTED, SERIES, new_figure, styled
from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.errors import DatasetError, InvalidValueError, ShapeError
from ocplanner.guidance.settings import LabelSettings
from ocplanner.report.overlays import show_image

_MOMENTS = 3


@dataclass(frozen=True)
class JudgedEpisode:
    """An episode of a labelled data set, and a critic's values of its actions.

    Attributes:
        title: title of its column, such as "success".
        demos: the data set, with rewards written by ``ocplanner label``.
        name: name of the demonstration.
        values: (T,) a critic's value of each recorded action, or None.
    """

    title: str
    demos: Demonstrations
    name: str
    values: np.ndarray | None = None

    def plan_reward(self) -> np.ndarray:
        """(T,) the plan's part of the reward.

        Raises:
            DatasetError: the data set has no reward of a plan.
        """
        labels = self.demos.label_record
        mode = "off" if labels is None else LabelSettings.of(labels).reward
        if mode == "off":
            raise DatasetError(f"{self.demos.path} has no reward of a plan; write it with `ocplanner label --reward`")
        arrays = self.demos[self.name].arrays()
        return arrays["rewards"] - (arrays["rewards_sparse"] if mode == "augment" else 0.0)


def judged_figure(episodes: Sequence[JudgedEpisode], *, camera: str = "agentview", size: int = 256) -> Figure:
    """One column for each episode: three moments, the plan's reward at each step, and the critic's value if given.

    Args:
        episodes: episodes to compare; all curves of one kind share an axis.
        camera: name of the camera; the moments are drawn anew from the recorded states.
        size: side of each picture, pixels.

    Raises:
        InvalidValueError: no episode was given.
        DatasetError: an episode is not there, or has no reward of a plan.
        ShapeError: values and episode differ in length.
    """
    if not episodes:
        raise InvalidValueError("no episode to draw; give at least one")
    valued = any(episode.values is not None for episode in episodes)
    rows = 2 + valued
    with styled():
        figure = new_figure(2.6 * len(episodes) + 0.6, 1.0 + 1.35 * (rows - 1) + 0.9)
        grid = figure.subplots(rows, len(episodes), squeeze=False, sharey="row", height_ratios=[1.0, 1.35, 1.35][:rows])
        for column, episode in zip(grid.T, episodes):
            steps = np.linspace(0, episode.demos[episode.name].length - 1, _MOMENTS + 1)[1:].round().astype(int)
            with make_env(episode.demos.task_name, episode.demos.robots[0], cameras=()) as env:
                show_image(column[0], _moments(env, episode, steps, camera, size))
            column[0].set_title(episode.title)
            _curve(column[1], episode.plan_reward(), SERIES[0], steps)
            if valued:
                _curve(column[2], episode.values, SERIES[1], steps)
            column[-1].set_xlabel("control step")
        grid[1, 0].set_ylabel("plan's reward")
        if valued:
            grid[2, 0].set_ylabel("critic's value")
    return figure


def _moments(env: ManipulationEnv, episode: JudgedEpisode, steps: np.ndarray, camera: str, size: int) -> np.ndarray:
    """The moments side by side, (size, 3 size, 3) uint8."""
    states = episode.demos[episode.name].states
    pictures = []
    for step in steps:
        env.set_state(states[step])
        pictures.append(env.render(camera, size, size))
    return np.concatenate(pictures, axis=1)


def _curve(axes: Axes, values: np.ndarray | None, color: str, moments: np.ndarray) -> None:
    if values is None:
        axes.text(0.5, 0.5, "not valued", transform=axes.transAxes, ha="center", va="center", color=MUTED)
        return
    if len(values) != moments[-1] + 1:
        raise ShapeError(f"values: found {len(values)}, but the episode has {moments[-1] + 1} steps")
    axes.plot(values, color=color)
    axes.plot(moments, np.asarray(values)[moments], "o", color=INK, markersize=3.5, markerfacecolor="white")
    axes.set_xlim(0, moments[-1])
