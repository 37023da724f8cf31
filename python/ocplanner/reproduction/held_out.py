"""``heldout.json``: what each training measured on ``mask/valid``."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ocplanner.errors import ResultFileError
from ocplanner.files.records.metrics import METRICS, HeldOutErrors, read_metrics
from ocplanner.files.storage import atomic_json
from ocplanner.reproduction.experiments import PlannerExperiment
from ocplanner.versions import installed

NAME = "heldout.json"


def is_kept(experiment: PlannerExperiment, results: Path) -> bool:
    """Whether the results hold everything that training this planner gives: its rows, and its file if transfers use it.

    Raises:
        ResultFileError: ``heldout.json`` is damaged.
    """
    measured = any(row["planner"] == experiment.name for row in read(results)["rows"])
    return measured and (not experiment.transferred or experiment.file(results).exists())


def read(results: Path) -> dict[str, Any]:
    """The content of ``heldout.json``, without rows if there is no such file.

    Raises:
        ResultFileError: it cannot be read, or has no rows.
    """
    path = results / NAME
    if not path.exists():
        return {"rows": []}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = content["rows"]
        if not all(isinstance(row["planner"], str) for row in rows):
            raise TypeError("a row names no planner")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(f"{path} is damaged ({error!r}); restore it, or delete it to measure again") from error
    return content


def final_errors(run: Path) -> list[HeldOutErrors]:
    """The errors that a finished run recorded: one row for each candidate and arm shown.

    Raises:
        ResultFileError: the run's ``metrics.jsonl`` is missing or damaged.
    """
    return [row for row in read_metrics(run / METRICS) if isinstance(row, HeldOutErrors)]


def write(
    trained: Iterable[PlannerExperiment], order: Sequence[PlannerExperiment], work: Path, results: Path, command: str
) -> Path:
    """Put the rows of newly trained planners into ``heldout.json``, replacing the old rows of the same planners.

    There is one row for each planner, candidate (before and after fine-tuning) and arm shown. Rows of other planners
    stay; those measured with other versions than the installed ones name their versions.

    Args:
        trained: planners whose runs in ``work`` are finished.
        order: of the planners in the file; unknown ones come last.
        work: run folders.
        results: the folder of ``heldout.json``.
        command: the command that remakes the rows.

    Raises:
        ResultFileError: ``heldout.json`` is damaged.
        OutputError: it cannot be written.
    """
    old, versions = read(results), installed()
    rows: dict[str, list[dict[str, Any]]] = {}
    for row in old["rows"]:
        dated = row if old.get("versions") == versions else {"versions": old.get("versions"), **row}
        rows.setdefault(row["planner"], []).append(dated)
    for experiment in trained:
        facts = {"planner": experiment.name, **asdict(experiment)}
        rows[experiment.name] = [{**facts, **row.to_json()} for row in final_errors(work / experiment.name)]
    listed = {experiment.name: i for i, experiment in enumerate(order)}
    names = sorted(rows, key=lambda name: listed.get(name, len(listed)))
    content = {"command": command, "data": "Square PH, mask/valid", "versions": versions}
    atomic_json(results / NAME, {**content, "rows": [row for name in names for row in rows[name]]})
    return results / NAME
