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
from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.settings import DEFAULT_READING, ReadSettings
from ocplanner.demos.soundness import sound_names
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.tasks import Task
from ocplanner.errors import DatasetError
from ocplanner.files.records.render import RENDER_ATTRIBUTE
from ocplanner.files.storage import check_output
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
    reading: ReadSettings = DEFAULT_READING,
    limit: int | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Copy a data set and add images to it.

    If the function is stopped, the next call with the same settings continues and ends with the same file.

    Args:
        source: a robomimic data set with ``states``.
        target: the file to make.
        settings: what is drawn.
        workers: how many worker processes, and where.
        reading: how the source is read.
        limit: render only the first so many demonstrations.
        overwrite: replace ``target`` if it exists.
        progress: called after each demonstration, first for those that an earlier call finished.
        say: called with a line for each demonstration that is left out.

    Raises:
        InvalidValueError: ``limit`` is not positive.
        DatasetError: the source has no states, or they are another task's or arm's, or some demonstrations cannot be
            used.
        MismatchError: another arm, gripper or scene was recorded than is simulated.
        OutputError: the target exists, is the source, cannot be written, or was begun from another source.
        RenderingError: no working headless OpenGL.
        WorkerError: a demonstration killed its process three times (out of memory?).
        ClusterError: there is no Ray cluster at the address.
    """
    require(limit is None or limit >= 1, f"limit is {limit}, but must be at least 1")
    check_output(Path(target), overwrite, "HDF5 data set", [source], resumed=True)
    with Demonstrations(source, reading=reading) as demos:
        task = demos.task()
        if not demos.robots or demos.robots != demos.robots[:1] * task.arms:
            raise DatasetError(
                f"{demos.path}: recorded with {' and '.join(demos.robots) or 'no robot on record'}, but {task.name} "
                f"needs {'one arm' if task.arms == 1 else f'{task.arms} arms of one kind'}; record the data set again"
            )
        masks = {mask: demos.mask(mask) for mask in demos.mask_names}
        needed = partial(_needed, demos=demos, settings=settings, task=task)
        names = sound_names(demos, demos.names[:limit], needed, say)
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        attrs[RENDER_ATTRIBUTE] = settings.record().to_json()
        with DatasetWriter(target, demos.env_args, data_attrs=attrs, overwrite=overwrite, reads=[source]) as writer:
            done = {name for name in writer.done if name in names and writer.holds(name, demos[name].digest())}
            for name in names:
                if name in done and progress:
                    progress(name, demos[name].length)
            waiting = [number for number, name in enumerate(demos.names) if name in names and name not in done]
            make = partial(_Worker, demos.path.absolute(), reading, task.name, settings)
            for number, arrays in run_episodes(make, _Worker.render, waiting, workers):
                demo = demos[number]
                writer.add(demo.name, {**demo.arrays(), **arrays}, demo.attrs, demo.digest())
                if progress:
                    progress(demo.name, demo.length)
            masks = {mask: [name for name in listed if name in names] for mask, listed in masks.items()}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


def _needed(demo: Demonstration, demos: Demonstrations, settings: RenderSettings, task: Task) -> None:
    """Read what drawing a demonstration needs, and compare its world with the simulated one."""
    _ = demo.states
    demos.compare_world(demo)
    for spec in task.objects:
        demo.object_poses(spec.name)
        if settings.frames == "manipulation" or settings.silhouette_arms:
            demo.manipulation(spec.name)


class _Worker:
    """The source and the renderer of one process."""

    def __init__(self, source: Path, reading: ReadSettings, task_name: str, settings: RenderSettings) -> None:
        self._demos = Demonstrations(source, reading=reading)
        self._renderer = FrameRenderer(task_name, self._demos.robots[0], settings, self._demos.grippers)

    def render(self, number: int) -> dict[str, np.ndarray]:
        return self._renderer.render(self._demos[number])

    def close(self) -> None:
        self._demos.close()
        self._renderer.close()
