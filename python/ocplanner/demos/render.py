"""From recorded states to pictures: a copy of a data set with camera images, made by several processes.

With ``observe="masked"`` the copy also holds what augmentation needs: the scene without the robot, its mask, and the
masks that other arms would have with their end effector where the recorded one is.
"""

import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np

from ocplanner.demos.dataset import RENDER_ATTRIBUTE, Demonstrations
from ocplanner.demos.frames import FrameRenderer, RenderSettings
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.tasks import task_of_env
from ocplanner.errors import DatasetError, InvalidValueError, OcplannerError

Progress = Callable[[str, int], None]
"""Called with the name and the number of steps of each demonstration that is done."""


def render_dataset(
    source: str | Path,
    target: str | Path,
    settings: RenderSettings,
    *,
    workers: int = 1,
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
        limit: render the first so many demonstrations only.
        overwrite: replace ``target`` if it is there.
        progress: called after each demonstration; those of an earlier run come first.

    Raises:
        DatasetError: the source has no states, or they are another task's or arm's.
        OutputError: the target exists or cannot be written.
        RenderingError: no working headless OpenGL.
    """
    if workers < 1 or (limit is not None and limit < 1):
        raise InvalidValueError(f"workers and limit must be at least 1, not {workers} and {limit}")
    with Demonstrations(source) as demos:
        task = task_of_env(demos.env_name)
        if len(demos.robots) != 1:
            raise DatasetError(f"{demos.path}: recorded with {demos.robots or 'no robot'}; one arm can be rendered")
        names = demos.names[:limit]
        attrs = {key: value for key, value in demos.attrs.items() if key not in {"env_args", "total"}}
        attrs[RENDER_ATTRIBUTE] = json.dumps(settings.record(), sort_keys=True)
        with DatasetWriter(target, demos.env_args, data_attrs=attrs, overwrite=overwrite) as writer:
            done = set(writer.done)
            for name in names:
                if name in done and progress:
                    progress(name, demos[name].length)
            waiting = [name for name in names if name not in done]
            workplace = (demos.path, task.name, demos.robots[0], settings)
            for name, arrays in _rendered(workplace, waiting, workers):
                demo = demos[name]
                writer.add(name, {**demo.arrays(), **arrays}, demo.attrs)
                if progress:
                    progress(name, demo.length)
            masks = {mask: [name for name in demos.mask(mask) if name in names] for mask in demos.mask_names}
            return writer.finish({mask: listed for mask, listed in masks.items() if listed}, names)


_Workplace = tuple[Path, str, str, RenderSettings]


def _rendered(workplace: _Workplace, names: Sequence[str], workers: int) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """The arrays of each demonstration as they get ready; at most two a worker are in flight."""
    if workers == 1 or len(names) < 2:
        worker = _Worker(*workplace)
        try:
            for name in names:
                yield name, worker.render(name)
        finally:
            worker.close()
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _start_worker, workplace) as pool:
        queue, running = iter(names), {}
        try:
            while True:
                while len(running) < 2 * workers and (name := next(queue, None)) is not None:
                    running[pool.submit(_render_in_worker, name)] = name
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        except BrokenProcessPool as error:
            raise OcplannerError(
                "a rendering process died (out of memory?); run the same command again to go on"
            ) from error
        finally:
            for future in running:
                future.cancel()


class _Worker:
    """The source and the environments of one process; made when the first demonstration asks for them."""

    def __init__(self, source: Path, task_name: str, robot: str, settings: RenderSettings) -> None:
        self._demos = Demonstrations(source)
        self._make = lambda: FrameRenderer(task_name, robot, settings)
        self._renderer: FrameRenderer | None = None

    def render(self, name: str) -> dict[str, np.ndarray]:
        if self._renderer is None:
            self._renderer = self._make()
        return self._renderer.render(self._demos[name])

    def close(self) -> None:
        self._demos.close()
        if self._renderer is not None:
            self._renderer.close()


_worker: _Worker | None = None


def _start_worker(*workplace: object) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which lets its workers finish
    # Mesa's software renderer starts a thread a core; with a process a core those only get in each other's way.
    os.environ.setdefault("LP_NUM_THREADS", "1")
    _worker = _Worker(*workplace)  # type: ignore[arg-type]


def _render_in_worker(name: str) -> dict[str, np.ndarray]:
    if _worker is None:
        raise RuntimeError("the worker was not started")
    return _worker.render(name)
