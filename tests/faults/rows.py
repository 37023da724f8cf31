"""What was injected and what came of it."""

from dataclasses import asdict, dataclass, field
from typing import Any

_MOST_NOTES = 8


@dataclass
class Row:
    """One verb under one fault.

    Attributes:
        verb: as on the command line.
        fault: what was done to it.
        tries: how often the fault struck.
        lost: tries after which something written was gone, half-written, damaged or unlike the undisturbed result.
        unclear: tries that ended otherwise than with success or one clear error and exit status 2.
        compared: how results equal the undisturbed one: ``bytes``, or ``arrays``; None where there are none.
        skipped: why the fault could not be injected here.
        notes: what went wrong, the first few.
    """

    verb: str
    fault: str
    tries: int = 0
    lost: int = 0
    unclear: int = 0
    compared: str | None = None
    skipped: str | None = None
    notes: list[str] = field(default_factory=list)

    def lose(self, what: str) -> None:
        """Count a loss."""
        self.lost += 1
        self._note(f"lost: {what}")

    def wonder(self, what: str) -> None:
        """Count an unclear ending."""
        self.unclear += 1
        self._note(f"unclear: {what}")

    def _note(self, text: str) -> None:
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(text)

    def record(self) -> dict[str, Any]:
        """As JSON; what does not apply is left out."""
        always = ("verb", "fault", "tries", "lost", "unclear")
        return {key: value for key, value in asdict(self).items() if key in always or value}

    def __str__(self) -> str:
        """One line."""
        text = f"{self.verb:17} {self.fault:32} tries {self.tries:4}  lost {self.lost:3}  unclear {self.unclear:3}"
        return text + (f"  skipped: {self.skipped}" if self.skipped else "")
