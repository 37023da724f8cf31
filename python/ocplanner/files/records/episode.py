"""One line of a journal, and one row of a result file: how an episode ended."""

from dataclasses import asdict, dataclass
from typing import Any

MOST_EPISODES = 1_000_000
"""More of one evaluation or transfer are taken for a mistake."""


@dataclass(frozen=True)
class EpisodeResult:
    """One episode's outcome; :func:`ocplanner.settings.build` reads it.

    Attributes:
        seed: seed of the reset.
        success: whether the task was solved.
        steps: control steps used.
        failure: class of a failure, or None.
        released_by: ``"follower"`` if the object was released because of the plan; None otherwise.
        failed_with: the active object when a task with several objects failed, or None.
    """

    seed: int
    success: bool
    steps: int
    failure: str | None = None
    released_by: str | None = None
    failed_with: str | None = None

    def to_json(self) -> dict[str, Any]:
        """The row; ``failed_with`` only where it says something."""
        content = asdict(self)
        if self.failed_with is None:
            del content["failed_with"]
        return content
