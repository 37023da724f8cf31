"""``table1.json`` and ``table2.json``: the paper's tables of policies from the evaluations of single trainings."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.files.records.evaluation import PolicyResult
from ocplanner.files.storage import atomic_json
from ocplanner.policies.config import PolicyTraining, training_from_dict
from ocplanner.reproduction.policy_experiments import (
    VARIANTS,
    PolicyExperiment,
    RewardKind,
    table1_experiments,
    table2_experiments,
)
from ocplanner.rollouts.intervals import rate_interval

Cell = tuple[str, str, str]
"""Algorithm, observations, variant."""


@dataclass(frozen=True)
class PolicyTable:
    """One of the paper's tables.

    Attributes:
        number: in the paper.
        experiments: its trainings, given the seeds.
        published: best checkpoint in percent, mean and deviation over three seeds: robomimic's and the paper's.
    """

    number: int
    experiments: Callable[[Sequence[int]], tuple[PolicyExperiment, ...]]
    published: Mapping[Cell, tuple[float, float]]

    @property
    def name(self) -> str:
        """Of the file, in the folder of results."""
        return f"table{self.number}.json"

    def write(self, experiments: Iterable[PolicyExperiment], results: Path) -> None:
        """Gather the evaluations that are there, rates in percent. Without any, nothing is written.

        Raises:
            ResultFileError: an evaluation is damaged.
            OutputError: the file cannot be written.
        """
        cells: dict[Cell, list[PolicyExperiment]] = {}
        for experiment in experiments:
            if experiment.result(results).exists():
                cell = experiment.algorithm, experiment.observations, experiment.variant
                cells.setdefault(cell, []).append(experiment)
        rows = [self._row(cell, found, results) for cell, found in sorted(cells.items(), key=_order)]
        if rows:
            command = f"ocplanner reproduce --table {self.number}"
            atomic_json(results / self.name, {"command": command, "data": "Square PH, mask/train", "cells": rows})

    def read(self, results: Path) -> list[dict[str, Any]]:
        """The cells of the file; none if there is no such file.

        Raises:
            ResultFileError: it is damaged.
        """
        path = results / self.name
        if not path.exists():
            return []
        try:
            return list(json.loads(path.read_text(encoding="utf-8"))["cells"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ResultFileError(
                f"{path} is damaged ({error!r}); remake it with `ocplanner reproduce --table {self.number}`"
            ) from error

    def _row(self, cell: Cell, found: list[PolicyExperiment], results: Path) -> dict[str, Any]:
        evaluations = [PolicyResult.load(experiment.result(results)) for experiment in found]
        best = [100 * evaluation.best for evaluation in evaluations]
        last = [100 * evaluation.last_five for evaluation in evaluations]
        interval = rate_interval([evaluation.last_outcomes for evaluation in evaluations])
        published = self.published.get(cell)
        return {
            "algorithm": cell[0],
            "observation": cell[1],
            "variant": _variant(cell[2]),
            "kind": cell[2],
            "preset": "cpu",
            "seeds": [
                {"seed": experiment.seed, "best": highest, "last5": mean}
                for experiment, highest, mean in zip(found, best, last, strict=True)
            ],
            "budgets": sorted({_budget(training_from_dict(evaluation.training)) for evaluation in evaluations}),
            "checkpoints": [len(evaluation.checkpoints) for evaluation in evaluations],
            "episodes": evaluations[0].settings.episodes,
            "best_mean": float(np.mean(best)),
            "best_std": float(np.std(best)),
            "last5_mean": float(np.mean(last)),
            "last5_std": float(np.std(last)),
            "last5_interval": [100 * bound for bound in interval],
            "published_best": None if published is None else list(published),
        }


TABLE1 = PolicyTable(
    1,
    table1_experiments,
    {
        ("bc", "state", ""): (78.7, 1.9),
        ("bc-rnn", "state", ""): (84.0, 0.0),
        ("bc", "image", ""): (62.0, 4.9),
        ("bc-rnn", "image", ""): (82.0, 0.0),
        ("bc", "image", "k1"): (69.3, 3.1),
        ("bc-rnn", "image", "k1"): (80.7, 1.2),
    },
)
TABLE2 = PolicyTable(
    2,
    table2_experiments,
    {
        ("bcq", "state", ""): (50.0, 4.9),
        ("bcq", "image", ""): (41.3, 4.1),
        ("bcq", "image", "augment"): (44.7, 8.3),
        ("bcq", "image", "only"): (46.7, 8.3),
    },
)
TABLES = {table.number: table for table in (TABLE1, TABLE2)}


def _variant(kind: str) -> str:
    """``original``, ``hint``, ``augment`` or ``only``; ``kind``, a key of :data:`VARIANTS`, says more."""
    made = VARIANTS[kind] if kind else None
    return "original" if made is None else made.mode if isinstance(made, RewardKind) else "hint"


def _order(item: tuple[Cell, Any]) -> tuple[bool, str, int]:
    algorithm, observations, variant = item[0]
    return observations == "image", algorithm, ["", *VARIANTS].index(variant)


def _budget(training: PolicyTraining) -> str:
    return f"{training.steps:,} x {training.batch}"
