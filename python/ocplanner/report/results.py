"""Group zero-shot results that differ only in the planner, and so in its training seed."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocplanner.rollouts.intervals import seed_level_interval
from ocplanner.zero_shot.result import FAILURES, TransferResult


@dataclass(frozen=True)
class TransferGroup:
    """Results of one task, robot, observation and one set of conditions: one for each planner evaluated."""

    records: tuple[TransferResult, ...]

    @property
    def title(self) -> str:
        """What was run."""
        return self.records[0].title

    @property
    def mean_rate(self) -> float:
        """Mean success rate over the planners."""
        return sum(record.rate for record in self.records) / len(self.records)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean rate: Wilson's for one planner; for several, over planners and their episodes."""
        if len(self.records) == 1:
            return self.records[0].interval
        return seed_level_interval([np.array([run.success for run in record.runs]) for record in self.records])

    @property
    def failures(self) -> Counter[str]:
        """Failure classes counted over all planners."""
        return sum((record.failures for record in self.records), Counter())


def group_results(records: Iterable[TransferResult]) -> list[TransferGroup]:
    """Group results that differ only in the planner, in the order in which each group first appears."""
    groups: dict[tuple[Any, ...], list[TransferResult]] = {}
    for record in records:
        groups.setdefault(record.conditions, []).append(record)
    return [TransferGroup(tuple(members)) for members in groups.values()]


def failure_classes(groups: Sequence[TransferGroup]) -> list[str]:
    """The classes to show: the known ones in order, then any other that occurs."""
    found = {name for group in groups for name in group.failures}
    return [*FAILURES, *sorted(found - set(FAILURES))]
