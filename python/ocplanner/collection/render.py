"""A copy of a data set with camera images, drawn from the recorded states by several processes.

With ``observe="masked"`` the copy also holds what augmentation needs: the scene without the robot, the robot's mask,
and the masks of other arms with their end effector at the recorded one's pose.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ocplanner.collection.frame_renderer import FrameRenderer
from ocplanner.collection.settings import RenderSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.tasks import task_of_env
from ocplanner.errors import DatasetError
from ocplanner.files.records.render import RENDER_ATTRIBUTE
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import require

_ONE_WORKER = WorkerSettings()

Progress = Callable[[str, int], None]
"""Called with the name and the number of steps of each finished demonstration."""


def render_dataset(
    source: str | Path,
    target: str | Path,
    settings: RenderSettings,
    workers: WorkerSettings = _ONE_WORKER,
    *,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Copy a data set and add images to it.

    If the function is stopped, the next call with the same settings continues and ends with the same file.

    Args:
        source: a robomimic data set with ``states``.
        target: the file to make.
        settings: what is drawn.
        workers: how many worker processes, and where.
        limit: render only the first so many demonstrations.
        overwrite: replace ``target`` if it exists.
        progress: called after each demonstration, first for those that an earlier call finished.

    Raises:
        InvalidValueError: ``limit`` is not positive.
        DatasetError: the source has no states, or they are another task's or arm's.
        OutputError: the target exists or cannot be written.
        RenderingError: no working headless OpenGL.
        WorkerError: a demonstration killed its process three times (out of memory?).
        ClusterError: there is no Ray cluster at the address.
    """
    require(limit is None or limit >= 1, f"limit is {limit}, but must be at least 1")
    with Demonstrations(source) as demos:
        task = task_of_env(demos.env_name)
        if not demos.robots or demos.robots != demos.robots[:1] * task.arms:
            raise DatasetError(
                f"{demos.path}: recorded with {' and '.join(demos.robots) or 'no robot on record'}, but {task.name} "
                f"needs {'one arm' if task.arms == 1 else f'{task.arms} arms of one kind'}; record the data set again"
            )
        names = demos.names[:limit]
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        attrs[RENDER_ATTRIBUTE] = settings.record().to_json()
        with DatasetWriter(target, demos.env_args, data_attrs=attrs, overwrite=overwrite) as writer:
            done = set(writer.done)
            for name in names:
                if name in done and progress:
                    progress(name, demos[name].length)
            waiting = [number for number, name in enumerate(names) if name not in done]
            make = partial(_Worker, demos.path.absolute(), task.name, demos.robots[0], settings)
            for number, arrays in run_episodes(make, _Worker.render, waiting, workers):
                demo = demos[number]
                writer.add(demo.name, {**demo.arrays(), **arrays}, demo.attrs)
                if progress:
                    progress(demo.name, demo.length)
            masks = {mask: [name for name in demos.mask(mask) if name in names] for mask in demos.mask_names}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


class _Worker:
    """The source and the renderer of one process."""

    def __init__(self, source: Path, task_name: str, robot: str, settings: RenderSettings) -> None:
        self._demos = Demonstrations(source)
        self._renderer = FrameRenderer(task_name, robot, settings)

    def render(self, number: int) -> dict[str, np.ndarray]:
        return self._renderer.render(self._demos[number])

    def close(self) -> None:
        self._demos.close()
        self._renderer.close()
