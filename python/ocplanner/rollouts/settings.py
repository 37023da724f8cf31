"""Which workers run episodes, and which seeds are for evaluation."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from ocplanner.settings import require

FIRST_EVALUATION_SEED = 10000
"""Seeds from here on are for evaluation only; no demonstration is recorded with them."""


@dataclass(frozen=True)
class WorkerSettings:
    """How many workers run episodes in parallel, and where. Results do not depend on it.

    Raises:
        InvalidValueError: ``workers`` is not positive.
    """

    workers: int = 1
    """Worker processes."""
    ray: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Run the workers on a Ray cluster: HOST:PORT, 'auto', or 'local' for a cluster on this machine."""

    def __post_init__(self) -> None:
        """Check the number of workers."""
        require(self.workers >= 1, f"workers is {self.workers}, but must be at least 1")
