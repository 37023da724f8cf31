"""Episodes in processes of this machine."""

import contextlib
from multiprocessing.connection import Connection, wait

from ocplanner.errors import OcplannerError
from ocplanner.rollouts.pool import EPISODE, Task, TaskResult
from ocplanner.rollouts.worker import Worker, serve


class ProcessPool:
    """Fresh processes, started when they are needed; see :class:`ocplanner.rollouts.pool.WorkerPool`.

    Args:
        task: what each process runs; it and the results must be picklable.
        workers: number of processes.
    """

    def __init__(self, task: Task, workers: int) -> None:
        self._task = task
        self._workers = workers
        self._idle: list[Worker] = []
        self._busy: dict[Connection, tuple[Worker, int]] = {}

    def submit(self, seed: int) -> bool:
        """Start an episode on an idle process, or on a new one if the pool is not full."""
        if len(self._busy) >= self._workers:
            return False
        worker = self._idle.pop() if self._idle else Worker(_work, self._task)
        self._busy[worker.channel] = (worker, seed)
        worker.send(seed)
        return True

    def wait(self) -> list[TaskResult]:
        """Wait until an episode has ended."""
        return [self._read(channel) for channel in wait(list(self._busy)) if isinstance(channel, Connection)]

    def close(self) -> None:
        """Stop the processes; idle ones may close their context first."""
        for worker in self._idle:
            worker.stop(busy=False)
        for worker, _ in self._busy.values():
            worker.stop(busy=True)

    def _read(self, channel: Connection) -> TaskResult:
        worker, seed = self._busy.pop(channel)
        try:
            result = TaskResult(seed, worker.receive())
        except EOFError:
            return TaskResult(seed, crash=f"exit status {worker.join()}")
        except OcplannerError as error:
            result = TaskResult(seed, error=error)
        self._idle.append(worker)
        return result


def _work(channel: Connection, task: Task) -> None:
    with contextlib.closing(task):
        serve(channel, task.run, EPISODE)
