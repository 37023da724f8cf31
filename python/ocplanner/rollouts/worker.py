"""A worker process at the other end of a pipe."""

import contextlib
import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any

from ocplanner.errors import OcplannerError, WorkerError

_PATIENCE_S = 10.0


class Worker:
    """A fresh process that runs ``target(channel, *arguments)``, which should :func:`serve` the channel.

    Args:
        target: what the process runs; picklable.
        *arguments: its further arguments; picklable.

    Attributes:
        channel: this end of the pipe.
    """

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.channel, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_run, args=(target, theirs, *arguments), daemon=True)
        # A Ctrl-C reaches all processes of a terminal; this one stops its workers, which inherit the mask.
        resource_tracker.ensure_running()  # at its first start it unblocks the signal
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    @property
    def pid(self) -> int:
        """The id of the process."""
        return self._process.pid or 0

    def send(self, message: Any) -> None:
        """Send a message. If the process is dead, the next :meth:`receive` says so."""
        with contextlib.suppress(OSError):
            self.channel.send(message)

    def receive(self) -> Any:
        """Wait for the answer to a message.

        Raises:
            EOFError: the process is dead.
            OcplannerError: what the process raised; an unexpected exception arrives as a :class:`WorkerError`.
        """
        try:
            answer = self.channel.recv()
        except OSError as error:
            raise EOFError("the connection is broken") from error
        if isinstance(answer, OcplannerError):
            raise answer
        return answer

    def join(self) -> int | None:
        """Wait for a dying process and return its exit status."""
        self.channel.close()
        self._process.join()
        return self._process.exitcode

    def stop(self, *, busy: bool) -> None:
        """Stop the process: at once if it is busy; otherwise it gets time to close its resources."""
        self.send(None)
        self._process.join(timeout=0.0 if busy else _PATIENCE_S)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()
        self.channel.close()


def serve(channel: Connection, answer: Callable[[Any], Any], task: str) -> None:
    """In the worker process: answer each message until None arrives or the other end is closed.

    Exceptions are sent back in place of the answer.

    Args:
        channel: the worker's end of the pipe.
        answer: maps a message to its answer.
        task: what errors call a message; ``{}`` stands for the message itself.
    """
    with contextlib.suppress(EOFError, KeyboardInterrupt):
        while (message := channel.recv()) is not None:
            try:
                channel.send(answer(message))
            except OcplannerError as error:
                channel.send(error)
            except Exception as error:
                channel.send(worker_error(task.format(message), error))


def worker_error(task: str, error: Exception) -> WorkerError:
    """The error that reports an unexpected exception of a worker; the worker's traceback is attached as a note."""
    reported = WorkerError(f"{task} failed: {type(error).__name__}: {error}")
    reported.add_note("".join(["in the worker:\n", *traceback.format_exception(error)]))
    return reported


def limit_renderer_threads() -> None:
    """Let Mesa's software renderer use one thread, unless ``LP_NUM_THREADS`` is set; call it before drawing.

    By default it starts one thread for each core. With several workers these threads only compete.
    """
    os.environ.setdefault("LP_NUM_THREADS", "1")


def _run(target: Callable[..., None], channel: Connection, *arguments: Any) -> None:
    limit_renderer_threads()
    target(channel, *arguments)
