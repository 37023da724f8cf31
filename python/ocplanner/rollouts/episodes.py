"""Episodes dealt out to workers, with results that depend on the seeds alone."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from ocplanner.errors import InvalidValueError, WorkerError
from ocplanner.rollouts.pool import Crew, close_context
from ocplanner.rollouts.process_pool import ProcessCrew
from ocplanner.rollouts.ray_pool import RayCrew

Context = TypeVar("Context")
Result = TypeVar("Result")

_TRIES = 3


def run_episodes(
    make: Callable[[], Context],
    episode: Callable[[Context, int], Result],
    seeds: Sequence[int],
    workers: int = 1,
    *,
    ray: str | None = None,
) -> Iterator[tuple[int, Result]]:
    """Run one episode for each seed and give the results as they come, in any order.

    With one worker everything runs here. With more, or on Ray, each worker is a fresh process that makes its own
    context; one that dies (killed, out of memory, a crash in native code, a machine of the cluster gone) is replaced
    and its episode begun again.

    Args:
        make: makes what an episode needs (environment, planner); picklable.
        episode: runs one episode; picklable, and so is its result.
        seeds: one an episode.
        workers: processes.
        ray: run them on a Ray cluster: its address, ``"auto"`` for the one that this machine belongs to, ``"local"``
            for one on this machine that lasts as long as the episodes. A connection that is there already is used.
            Files that the job names must be found on every machine under the same path.

    Yields:
        (seed, result).

    Raises:
        InvalidValueError: ``workers`` is not positive.
        WorkerError: an episode killed its worker three times.
        ClusterError: there is no Ray cluster, or its workers cannot start.
        VersionError: Ray is not installed.
        OcplannerError: as raised by ``make`` or ``episode``.
    """
    if not seeds:
        return
    if workers < 1:
        raise InvalidValueError(f"workers is {workers}, but must be at least 1")
    if ray is not None:
        yield from _deal(RayCrew(make, episode, min(workers, len(seeds)), ray), seeds)
    elif workers > 1:
        yield from _deal(ProcessCrew(make, episode, min(workers, len(seeds))), seeds)
    else:
        context = make()
        try:
            for seed in seeds:
                yield seed, episode(context, seed)
        finally:
            close_context(context)


def _deal(crew: Crew, seeds: Sequence[int]) -> Iterator[tuple[int, Any]]:
    waiting, in_hand = deque(seeds), 0
    tries: Counter[int] = Counter()
    try:
        while waiting or in_hand:
            while waiting and crew.hand_out(waiting[0]):
                tries[waiting.popleft()] += 1
                in_hand += 1
            for ended in crew.collect():
                in_hand -= 1
                if ended.error is not None:
                    raise ended.error
                if ended.death is None:
                    yield ended.seed, ended.result
                elif tries[ended.seed] < _TRIES:
                    waiting.appendleft(ended.seed)
                else:
                    raise WorkerError(
                        f"the episode of seed {ended.seed} killed its worker {_TRIES} times, lastly: {ended.death}"
                    )
    finally:
        crew.close()
