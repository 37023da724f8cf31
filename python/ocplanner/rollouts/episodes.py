"""Episodes spread over workers; the results depend only on the seeds."""

import contextlib
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from ocplanner.errors import WorkerError
from ocplanner.rollouts.pool import EPISODE, Task, WorkerPool
from ocplanner.rollouts.process_pool import ProcessPool
from ocplanner.rollouts.ray_pool import RayPool
from ocplanner.rollouts.settings import WorkerSettings

Context = TypeVar("Context")
Result = TypeVar("Result")

_TRIES = 3
_ONE_WORKER = WorkerSettings()


def run_episodes(
    make: Callable[[], Context],
    episode: Callable[[Context, int], Result],
    seeds: Sequence[int],
    workers: WorkerSettings = _ONE_WORKER,
) -> Iterator[tuple[int, Result]]:
    """Run one episode for each seed and yield the results in the order in which the episodes end.

    One worker without Ray is this process. Otherwise each worker is a fresh process that makes its own context. If a
    worker dies (killed, out of memory, a crash in native code, a lost machine of the cluster), another replaces it and
    the episode starts again.

    Args:
        make: makes what episodes run in (environment, planner); picklable.
        episode: runs one episode; it and its result are picklable.
        seeds: one for each episode.
        workers: how many workers, and where. On a Ray cluster, every machine must find the files that ``make`` and
            ``episode`` name under the same paths.

    Yields:
        (seed, result).

    Raises:
        WorkerError: an episode killed its worker three times, or raised an unexpected exception in a worker; a note
            holds the worker's traceback. In this process the exception itself is raised.
        ClusterError: no Ray cluster answers, or its workers do not start.
        VersionError: Ray is not installed.
        OcplannerError: as raised by ``make`` or ``episode``.
    """
    if not seeds:
        return
    task = Task(make, episode)
    count = min(workers.workers, len(seeds))
    if workers.ray is not None:
        yield from _run_in(RayPool(task, count, workers.ray), seeds)
    elif workers.workers > 1:
        yield from _run_in(ProcessPool(task, count), seeds)
    else:
        with contextlib.closing(task):
            for seed in seeds:
                yield seed, task.run(seed)


def _run_in(pool: WorkerPool, seeds: Sequence[int]) -> Iterator[tuple[int, Any]]:
    waiting, running = deque(seeds), 0
    tries: Counter[int] = Counter()
    with contextlib.closing(pool):
        while waiting or running:
            while waiting and pool.submit(waiting[0]):
                tries[waiting.popleft()] += 1
                running += 1
            for ended in pool.wait():
                running -= 1
                if ended.error is not None:
                    raise ended.error
                if ended.crash is None:
                    yield ended.seed, ended.result
                elif tries[ended.seed] < _TRIES:
                    waiting.appendleft(ended.seed)
                else:
                    raise WorkerError(
                        f"{EPISODE.format(ended.seed)} killed its worker {_TRIES} times, most recently: {ended.crash}"
                    )
