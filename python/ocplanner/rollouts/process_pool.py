"""Episodes in processes of this machine."""

from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from typing import Any

from ocplanner.errors import OcplannerError
from ocplanner.rollouts.pool import Ended, close_context
from ocplanner.rollouts.worker import Worker, serve


class ProcessCrew:
    """Fresh processes, started as they are needed; see :class:`ocplanner.rollouts.pool.Crew`.

    Args:
        make: makes what an episode needs; picklable.
        episode: runs one episode; picklable, and so is its result.
        workers: processes.
    """

    def __init__(self, make: Callable[[], Any], episode: Callable[[Any, int], Any], workers: int) -> None:
        self._job = (make, episode)
        self._workers = workers
        self._idle: list[Worker] = []
        self._busy: dict[Connection, tuple[Worker, int]] = {}

    def hand_out(self, seed: int) -> bool:
        """Give an episode to an idle process, or to a new one if there may be more."""
        if len(self._busy) >= self._workers:
            return False
        worker = self._idle.pop() if self._idle else Worker(_work, *self._job)
        self._busy[worker.channel] = (worker, seed)
        worker.send(seed)
        return True

    def collect(self) -> list[Ended]:
        """Wait until an episode has ended."""
        return [self._read(channel) for channel in wait(list(self._busy)) if isinstance(channel, Connection)]

    def close(self) -> None:
        """End the processes, kindly unless they are busy."""
        for worker in self._idle:
            worker.dismiss(busy=False)
        for worker, _ in self._busy.values():
            worker.dismiss(busy=True)

    def _read(self, channel: Connection) -> Ended:
        worker, seed = self._busy.pop(channel)
        try:
            kind, value = worker.receive()
        except EOFError:
            return Ended(seed, death=f"exit status {worker.bury()}")
        self._idle.append(worker)
        return Ended(seed, error=value) if kind == "error" else Ended(seed, value)


def _work(channel: Connection, make: Callable[[], Any], episode: Callable[[Any, int], Any]) -> None:
    made: list[Any] = []

    def play(seed: int) -> tuple[str, Any]:
        try:
            if not made:
                made.append(make())
            return "result", episode(made[0], seed)
        except OcplannerError as error:
            return "error", error

    try:
        serve(channel, play)
    finally:
        for context in made:
            close_context(context)
