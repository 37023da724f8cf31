"""A process of our own at the other end of a pipe."""

import contextlib
import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

_PATIENCE_S = 10.0


class Worker:
    """A fresh process that runs ``target(channel, *arguments)`` until it reads None from the channel, or its end.

    Args:
        target: what it runs; picklable.
        *arguments: for it; picklable.

    Attributes:
        channel: this end of the pipe.
    """

    def __init__(self, target: Callable[..., None], *arguments: Any) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.channel, theirs = spawn.Pipe()
        self._process = spawn.Process(target=target, args=(theirs, *arguments), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid or 0

    def send(self, message: Any) -> None:
        """Send a message; that the process is dead shows when its answer is read."""
        with contextlib.suppress(OSError):
            self.channel.send(message)

    def receive(self) -> Any:
        """Wait for a message.

        Raises:
            EOFError: the process is dead.
        """
        try:
            return self.channel.recv()
        except OSError as error:
            raise EOFError("the connection is broken") from error

    def bury(self) -> int | None:
        """Clear away a process that is dead; its exit status."""
        self.channel.close()
        self._process.join()
        return self._process.exitcode

    def dismiss(self, *, busy: bool) -> None:
        """End the process: at once if it is busy, else give it time to close what it has."""
        self.send(None)
        self._process.join(timeout=0.0 if busy else _PATIENCE_S)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()
        self.channel.close()


def serve(channel: Connection, answer: Callable[[Any], Any]) -> None:
    """In the process: answer every message until None comes or the other end is gone."""
    with contextlib.suppress(EOFError, KeyboardInterrupt):
        while (message := channel.recv()) is not None:
            channel.send(answer(message))
