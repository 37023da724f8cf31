"""Every success rate that the paper states, beside what was measured here."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ocplanner.report.results import TransferGroup
from ocplanner.reproduction.experiments import TransferExperiment
from ocplanner.reproduction.policy_experiments import VARIANTS
from ocplanner.reproduction.policy_tables import TABLES, PolicyTable
from ocplanner.zero_shot.result import read_result

_HEAD = ("in the paper", "what", "paper %", "here %", "95 % interval", "training seeds", "remade by")
_FOLLOWED = {
    "open-loop": ("open-loop, the paper's way", '"failing by a small margin"'),
    "time": ("by time", "-"),
    "gated": ("gated, the default here", "-"),
}
"""Follow mode -> what it is called, and what the paper says of it."""
_NOT_MEASURED = "not measured yet"
_SEEDS = (0, 1, 2)


def comparison_table(results: Path) -> str:
    """A Markdown table: zero-shot (Section 4), then Tables 1 and 2.

    The paper's rates are those of the best checkpoint, mean and deviation over three seeds. Ours of policies are the
    best checkpoint and the mean of the last five, whose episodes together give the interval.

    Raises:
        ResultFileError: a result file is damaged.
    """
    rows = [*_zero_shot_rows(results)]
    for table in TABLES.values():
        rows += _policy_rows(table, table.read(results))
    lines = [f"| {' | '.join(_HEAD)} |", "| --- " * len(_HEAD) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _zero_shot_rows(results: Path) -> Iterator[Sequence[str]]:
    for follow, (called, said) in _FOLLOWED.items():
        names = [TransferExperiment("Sawyer", follow=follow, seed=seed).name for seed in _SEEDS]
        found = [read_result(path) for path in (results / f"{name}.json" for name in names) if path.exists()]
        here, interval, seeds = _NOT_MEASURED, "", ""
        if found:
            group = TransferGroup(tuple(found))
            here, interval, seeds = f"{100 * group.mean_rate:.1f}", _percent(group.interval), str(len(found))
        yield "Section 4, Figure 8", f"Sawyer, {called}", said, here, interval, seeds, "`reproduce zero-shot`"


def _policy_rows(table: PolicyTable, measured: Iterable[Mapping[str, Any]]) -> Iterator[Sequence[str]]:
    rows = {(row["algorithm"], row["observation"], row["kind"]): row for row in measured}
    planned = [(one.algorithm, one.observations, one.variant) for one in table.experiments(_SEEDS[:1])]
    for cell in dict.fromkeys([*table.published, *planned, *rows]):
        algorithm, observations, variant = cell
        what = f"{algorithm.upper()} ({observations}), {VARIANTS[variant] if variant else 'no plan'}"
        stated = table.published.get(cell)
        paper = "-" if stated is None else f"{stated[0]:.1f} ± {stated[1]:.1f}"
        yield (f"Table {table.number}", what, paper, *_measured(rows.get(cell)), f"`reproduce --table {table.number}`")


def _measured(row: Mapping[str, Any] | None) -> tuple[str, str, str]:
    if row is None:
        return _NOT_MEASURED, "", ""
    here = f"{row['best_mean']:.1f} best, {row['last5_mean']:.1f} last five"
    return here, _percent([bound / 100 for bound in row["last5_interval"]]), str(len(row["seeds"]))


def _percent(bounds: Sequence[float]) -> str:
    low, high = bounds
    return f"{100 * low:.1f}-{100 * high:.1f}"
