"""What hands episodes to workers: the one interface of local processes and of a Ray cluster."""

from dataclasses import dataclass
from typing import Any, Protocol

from ocplanner.errors import OcplannerError


@dataclass(frozen=True)
class Ended:
    """How an episode that was handed out came to its end.

    Attributes:
        seed: of the episode.
        result: what it returned.
        error: the error on purpose that it raised instead.
        death: how its worker died over it instead.
    """

    seed: int
    result: Any = None
    error: OcplannerError | None = None
    death: str | None = None


class Crew(Protocol):
    """Workers that each have at most one episode in hand and make their own context when they get the first."""

    def hand_out(self, seed: int) -> bool:
        """Give an episode to a worker that is free; False if none is."""
        ...

    def collect(self) -> list[Ended]:
        """Wait until something happens. Nothing may have ended: a worker may have become free."""
        ...

    def close(self) -> None:
        """End the workers, busy or not."""
        ...


def close_context(context: Any) -> None:
    """Close what episodes ran in, if it can be closed."""
    close = getattr(context, "close", None)
    if close is not None:
        close()
