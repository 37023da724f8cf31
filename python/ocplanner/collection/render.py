"""From recorded states to pictures: a copy of a data set with camera images, made by several processes.

With ``observe="masked"`` the copy also holds what augmentation needs: the scene without the robot, its mask, and the
masks that other arms would have with their end effector where the recorded one is.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ocplanner.collection.frames import FrameRenderer, RenderSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.tasks import task_of_env
from ocplanner.errors import DatasetError, InvalidValueError
from ocplanner.files.records.render import RENDER_ATTRIBUTE
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings

Progress = Callable[[str, int], None]
"""Called with the name and the number of steps of each demonstration that is done."""


def render_dataset(
    source: str | Path,
    target: str | Path,
    settings: RenderSettings,
    *,
    workers: int = 1,
    ray: str | None = None,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Copy a data set and add pictures to it.

    A run that was stopped, at whatever moment, goes on when called again with the same settings, and ends with the
    same file.

    Args:
        source: a robomimic data set with ``states``.
        target: the file to make.
        settings: what is drawn.
        workers: processes.
        ray: address of a Ray cluster for the workers; see :func:`ocplanner.rollouts.episodes.run_episodes`.
        limit: render the first so many demonstrations only.
        overwrite: replace ``target`` if it is there.
        progress: called after each demonstration; those of an earlier run come first.

    Raises:
        DatasetError: the source has no states, or they are another task's or arm's.
        OutputError: the target exists or cannot be written.
        RenderingError: no working headless OpenGL.
        WorkerError: a demonstration killed its process three times (out of memory?).
        ClusterError: there is no Ray cluster at the address.
    """
    if workers < 1 or (limit is not None and limit < 1):
        raise InvalidValueError(f"workers and limit must be at least 1, not {workers} and {limit}")
    with Demonstrations(source) as demos:
        task = task_of_env(demos.env_name)
        if not demos.robots or demos.robots != demos.robots[:1] * task.arms:
            raise DatasetError(
                f"{demos.path}: recorded with {demos.robots or 'no robot'}; {task.name} is rendered with "
                f"{'one arm' if task.arms == 1 else f'{task.arms} arms of one kind'}"
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
            for number, arrays in run_episodes(make, _Worker.render, waiting, WorkerSettings(workers, ray)):
                demo = demos[number]
                writer.add(demo.name, {**demo.arrays(), **arrays}, demo.attrs)
                if progress:
                    progress(demo.name, demo.length)
            masks = {mask: [name for name in demos.mask(mask) if name in names] for mask in demos.mask_names}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


class _Worker:
    """The source and the environments of one process; made when the first demonstration asks for them."""

    def __init__(self, source: Path, task_name: str, robot: str, settings: RenderSettings) -> None:
        self._demos = Demonstrations(source)
        self._make = lambda: FrameRenderer(task_name, robot, settings)
        self._renderer: FrameRenderer | None = None

    def render(self, number: int) -> dict[str, np.ndarray]:
        if self._renderer is None:
            self._renderer = self._make()
        return self._renderer.render(self._demos[number])

    def close(self) -> None:
        self._demos.close()
        if self._renderer is not None:
            self._renderer.close()
