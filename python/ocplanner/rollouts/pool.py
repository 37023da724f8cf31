"""The interface that local processes and a Ray cluster share: a pool of workers that run episodes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from ocplanner.errors import OcplannerError

EPISODE = "the episode of seed {}"
"""How errors name an episode."""


@dataclass(frozen=True)
class TaskResult:
    """The outcome of one episode: a result, an error or a crash.

    Attributes:
        seed: the episode's seed.
        result: what the episode returned.
        error: what it raised; an unexpected exception arrives as a :class:`ocplanner.errors.WorkerError`.
        crash: how its worker died.
    """

    seed: int
    result: Any = None
    error: OcplannerError | None = None
    crash: str | None = None


class WorkerPool(Protocol):
    """Workers that run one episode at a time; each makes its own context before its first episode."""

    def submit(self, seed: int) -> bool:
        """Start an episode on an idle worker; False if no worker is idle."""
        ...

    def wait(self) -> list[TaskResult]:
        """Wait for something to happen and return the episodes that ended; none if a worker became idle instead."""
        ...

    def close(self) -> None:
        """Stop all workers, busy or not."""
        ...


class Task:
    """What a worker runs: a context made once, and one episode after another in it.

    Args:
        make: makes the context.
        episode: runs one episode.
    """

    def __init__(self, make: Callable[[], Any], episode: Callable[[Any, int], Any]) -> None:
        self._make, self._episode = make, episode
        self._contexts: list[Any] = []

    def run(self, seed: int) -> Any:
        """Run one episode and return its result; the first call makes the context."""
        if not self._contexts:
            self._contexts.append(self._make())
        return self._episode(self._contexts[0], seed)

    def close(self) -> None:
        """Close the context if it exists and has a method ``close``."""
        for context in self._contexts:
            close = getattr(context, "close", None)
            if close is not None:
                close()
