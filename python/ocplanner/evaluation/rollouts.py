"""Episodes dealt out to processes, with results that depend on the seeds alone."""

import contextlib
import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from ocplanner.errors import OcplannerError, WorkerError

Context = TypeVar("Context")
Result = TypeVar("Result")

_TRIES = 3


def run_episodes(
    make: Callable[[], Context],
    episode: Callable[[Context, int], Result],
    seeds: Sequence[int],
    workers: int = 1,
) -> Iterator[tuple[int, Result]]:
    """Run one episode for each seed and give the results as they come, in any order.

    With one worker everything runs here. With more, each worker is a fresh process that makes its own context; one
    that dies (killed, out of memory, a crash in native code) is replaced and its episode begun again.

    Args:
        make: makes what an episode needs (environment, planner); picklable.
        episode: runs one episode; picklable, and so is its result.
        seeds: one an episode.
        workers: processes.

    Yields:
        (seed, result).

    Raises:
        WorkerError: an episode killed its worker three times.
        OcplannerError: as raised by ``make`` or ``episode``.
    """
    if workers <= 1:
        context = make()
        try:
            for seed in seeds:
                yield seed, episode(context, seed)
        finally:
            _close(context)
        return
    yield from _Crew(make, episode, min(workers, len(seeds))).run(seeds)


class _Crew:
    """Worker processes, each with at most one episode in hand."""

    def __init__(self, make: Callable[[], Any], episode: Callable[[Any, int], Any], workers: int) -> None:
        self._spawn = multiprocessing.get_context("spawn")
        self._job = (make, episode)
        self._workers = workers
        self._processes: dict[Connection, Any] = {}
        self._in_hand: dict[Connection, int] = {}

    def run(self, seeds: Sequence[int]) -> Iterator[tuple[int, Any]]:
        waiting = deque(seeds)
        tries = dict.fromkeys(seeds, 0)
        try:
            while waiting or self._in_hand:
                while waiting and len(self._in_hand) < self._workers:
                    seed = waiting.popleft()
                    tries[seed] += 1
                    self._hand_out(seed)
                for channel in wait(list(self._in_hand)):
                    if not isinstance(channel, Connection):
                        continue
                    seed = self._in_hand.pop(channel)
                    try:
                        kind, value = channel.recv()
                    except (EOFError, OSError):
                        self._bury(channel)
                        if tries[seed] >= _TRIES:
                            raise WorkerError(f"the episode of seed {seed} killed its process {_TRIES} times") from None
                        waiting.appendleft(seed)
                        continue
                    if kind == "error":
                        raise value
                    yield seed, value
        finally:
            for channel in list(self._processes):
                self._dismiss(channel)

    def _hand_out(self, seed: int) -> None:
        idle = next((channel for channel in self._processes if channel not in self._in_hand), None)
        if idle is None:
            idle, theirs = self._spawn.Pipe()
            process = self._spawn.Process(target=_work, args=(theirs, *self._job), daemon=True)
            process.start()
            theirs.close()
            self._processes[idle] = process
        self._in_hand[idle] = seed
        with contextlib.suppress(OSError):  # it died while idle: its end of file is read next, the episode begun again
            idle.send(seed)

    def _bury(self, channel: Connection) -> None:
        process = self._processes.pop(channel)
        channel.close()
        process.join()

    def _dismiss(self, channel: Connection) -> None:
        process = self._processes.pop(channel)
        busy = channel in self._in_hand
        try:
            channel.send(None)
        except OSError:
            busy = True
        process.join(timeout=0.0 if busy else 10.0)
        if process.is_alive():
            process.terminate()
            process.join()
        channel.close()


def _work(channel: Connection, make: Callable[[], Any], episode: Callable[[Any, int], Any]) -> None:
    context = None
    made = False
    try:
        while (seed := channel.recv()) is not None:
            try:
                if not made:
                    context, made = make(), True
                channel.send(("result", episode(context, seed)))
            except OcplannerError as error:
                channel.send(("error", error))
                return
    except (EOFError, KeyboardInterrupt):
        return
    finally:
        _close(context)


def _close(context: Any) -> None:
    close = getattr(context, "close", None)
    if close is not None:
        close()
