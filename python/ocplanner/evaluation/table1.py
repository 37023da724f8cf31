"""``table1.json``: the paper's Table 1 from the evaluations of single trainings."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ocplanner.errors import ResultFileError
from ocplanner.evaluation.intervals import wilson
from ocplanner.evaluation.policy_experiments import HINTS, PolicyExperiment
from ocplanner.storage import atomic_json

NAME = "table1.json"

PUBLISHED: Mapping[tuple[str, str, str], tuple[float, float]] = {
    ("bc", "state", ""): (78.7, 1.9),
    ("bc-rnn", "state", ""): (84.0, 0.0),
    ("bc", "image", ""): (62.0, 4.9),
    ("bc-rnn", "image", ""): (82.0, 0.0),
    ("bc", "image", "k1"): (69.3, 3.1),
    ("bc-rnn", "image", "k1"): (80.7, 1.2),
}
"""Best checkpoint in percent, mean and deviation over three seeds: robomimic's, and the paper's with hints."""


def write(experiments: Iterable[PolicyExperiment], results: Path, command: str) -> Path:
    """Gather the evaluations that are there into ``table1.json``: a row for each cell of the table.

    Raises:
        ResultFileError: an evaluation is damaged.
        OutputError: the file cannot be written.
    """
    cells: dict[tuple[str, str, str], list[PolicyExperiment]] = {}
    for experiment in experiments:
        if experiment.result(results).exists():
            cells.setdefault((experiment.algorithm, experiment.observations, experiment.hint), []).append(experiment)
    rows = [_row(cell, found, results) for cell, found in sorted(cells.items(), key=lambda item: _order(item[0]))]
    atomic_json(results / NAME, {"command": command, "data": "Square PH, mask/train", "rows": rows})
    return results / NAME


def read(results: Path) -> list[dict[str, Any]]:
    """The rows of ``table1.json``; none if there is no such file.

    Raises:
        ResultFileError: it is damaged.
    """
    path = results / NAME
    if not path.exists():
        return []
    try:
        return list(json.loads(path.read_text(encoding="utf-8"))["rows"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(
            f"{path} is damaged ({error!r}); remake it with `ocplanner reproduce --table 1`"
        ) from error


def _order(cell: tuple[str, str, str]) -> tuple[bool, str, int]:
    algorithm, observations, hint = cell
    return observations == "image", algorithm, list(HINTS).index(hint)


def _row(cell: tuple[str, str, str], found: list[PolicyExperiment], results: Path) -> dict[str, Any]:
    evaluations = [_evaluation(experiment.result(results)) for experiment in found]
    best = [100 * evaluation["best"] for evaluation in evaluations]
    last = [100 * evaluation["last_five"] for evaluation in evaluations]
    counts = [checkpoint["successes"] for evaluation in evaluations for checkpoint in evaluation["checkpoints"][-5:]]
    episodes = sum(len(evaluation["checkpoints"][-5:]) * evaluation["episodes"] for evaluation in evaluations)
    published = PUBLISHED.get(cell)
    return {
        "algorithm": cell[0],
        "observations": cell[1],
        "hint": cell[2],
        "seeds": [experiment.seed for experiment in found],
        "checkpoints": [len(evaluation["checkpoints"]) for evaluation in evaluations],
        "episodes": evaluations[0]["episodes"],
        "best": best,
        "best_mean": float(np.mean(best)),
        "best_std": float(np.std(best)),
        "last_five": last,
        "last_five_mean": float(np.mean(last)),
        "last_five_std": float(np.std(last)),
        "last_five_interval": [100 * bound for bound in wilson(sum(counts), episodes)],
        "published_best": None if published is None else list(published),
    }


def _evaluation(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        missing = {"best", "last_five", "episodes", "checkpoints"} - set(content)
    except (OSError, ValueError, TypeError) as error:
        raise ResultFileError(f"cannot read {path}: {error}; evaluate that policy again") from error
    if missing:
        raise ResultFileError(f"{path} is no evaluation of a policy: it lacks {', '.join(sorted(missing))}")
    return content
