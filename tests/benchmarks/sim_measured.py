"""What a case of the simulation benchmark gives, and its row in the result file."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class SimMeasured:
    """Seconds of one unit of work, by side.

    Attributes:
        seconds: side -> seconds; ``"ours"`` is one of them.
        unit: what the row shows: a rate (``.../s``), or seconds.
        clock: what the seconds are of.
        more: further entries of the row.
    """

    seconds: dict[str, float]
    unit: str
    clock: str
    more: dict[str, Any] = field(default_factory=dict)

    def row(self, case: str) -> dict[str, Any]:
        """As the result file holds it; a ratio above 1 means that we are faster."""
        shown = {name: _shown(value, self.unit) for name, value in self.seconds.items()}
        ours = self.seconds["ours"]
        return {
            "case": case,
            "unit": self.unit,
            "clock": self.clock,
            "ours": shown.pop("ours"),
            "peers": shown,
            "ratio": {peer: round(self.seconds[peer] / ours, 2) for peer in shown},
            **self.more,
        }


def _shown(seconds: float, unit: str) -> float:
    return float(f"{1 / seconds if unit.endswith('/s') else seconds:.4g}")


def table(rows: list[dict[str, Any]]) -> str:
    """A Markdown table: our figure, and every peer's with how many times worse it is."""
    lines = ["| case | ocplanner | beside it |", "| --- | ---: | --- |"]
    for row in rows:
        peers = "; ".join(f"{peer} {value} ({row['ratio'][peer]}x)" for peer, value in row["peers"].items())
        lines.append(f"| {row['case']} | {row['ours']} {row['unit']} | {peers} |")
    return "\n".join(lines)
