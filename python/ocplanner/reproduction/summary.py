"""Markdown tables of the measured results, from the result files themselves."""

import json
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ocplanner.errors import ResultFileError
from ocplanner.report.heat_map import HeatMap, cell_text, heat_map
from ocplanner.report.results import group_results
from ocplanner.reproduction import encoders, held_out
from ocplanner.reproduction.policy_experiments import VARIANTS
from ocplanner.reproduction.policy_tables import PolicyTable
from ocplanner.zero_shot.result import TransferResult, read_result, read_results

NOTHING = "Not measured yet."


def transfer_table(folder: Path) -> str:
    """The result files in a folder: one row for each set of conditions, one column for each robot.

    A cell lists the successes of each training seed in order, and their mean when there are several.

    Raises:
        ResultFileError: a file is damaged.
    """

    def setting(result: TransferResult) -> tuple[str, str]:
        follow, _, others = result.setting.partition(", ")
        return follow, others

    cells = _cells(_read(folder), setting, lambda result: result.robot)
    robots = sorted({robot for row in cells.values() for robot in row})
    return _table(("follow", "observe"), robots, {key: cells[key] for key in sorted(cells)})


def mask_error_table(folder: Path, perfect: Path) -> str:
    """Success rates with robot masks that are some pixels off, one column for each number of pixels.

    Args:
        folder: result files with a mask error.
        perfect: result files of the same transfers without one, shown as 0 px.

    Raises:
        ResultFileError: a file is damaged.
    """

    def setting(result: TransferResult) -> tuple[str, str]:
        return result.robot, result.settings.control.follow

    off = _read(folder)
    tried = {(*setting(result), result.planner_seed) for result in off}
    exact = [
        result
        for result in _read(perfect)
        if result.observe == "masked" and (*setting(result), result.planner_seed) in tried
    ]
    cells = _cells([*exact, *off], setting, lambda result: result.settings.mask_error)
    pixels = sorted({number for row in cells.values() for number in row})
    texts = {key: {f"{number} px": entry for number, entry in cells[key].items()} for key in sorted(cells)}
    return _table(("robot", "follow"), [f"{number} px" for number in pixels], texts)


def matrix_table(path: Path) -> str:
    """Successes and 95 % intervals of a ``matrix.json``, one row for each task, one column for each robot.

    Raises:
        ResultFileError: the file is damaged.
    """
    table = _matrix(path)
    cells: dict[tuple[str, ...], dict[str, str]] = {(row,): {} for row in table.rows}
    for (row, robot), group in table.cells.items():
        cells[(row,)][robot] = "{} ({})".format(*cell_text(group))
    return _table(("task",), table.robots, cells)


def failure_table(path: Path) -> str:
    """Failed episodes of a ``matrix.json`` by class, one row for each cell that has any.

    Raises:
        ResultFileError: the file is damaged.
    """
    failures = {cell: group.failures for cell, group in _matrix(path).cells.items() if group.failures}
    classes = sorted({name for counts in failures.values() for name in counts})
    rows = {cell: {name: str(count) for name, count in counts.items()} for cell, counts in failures.items()}
    return _table(("task", "robot"), classes, rows)


def _matrix(path: Path) -> HeatMap:
    return heat_map(group_results(read_results(path) if path.exists() else ()))


def pose_noise_table(folder: Path) -> str:
    """Successes with wrong poses, one row for each filter and rotation noise, one column for each position noise.

    Raises:
        ResultFileError: a file is damaged.
    """

    def setting(result: TransferResult) -> tuple[str, str]:
        steps, (_, degrees) = result.settings.pose_filter, result.settings.pose_noise
        return f"{steps} steps" if steps > 1 else "none", f"{degrees:g}°"

    results = _read(folder)
    cells = _cells(results, setting, lambda result: f"{result.settings.pose_noise[0]:g} mm")
    sizes = sorted({result.settings.pose_noise[0] for result in results})
    return _table(("averaged over", "rotation noise"), [f"{size:g} mm" for size in sizes], dict(sorted(cells.items())))


def held_out_table(results: Path) -> str:
    """The errors in ``heldout.json`` of each planner before and after fine-tuning, seen on the recorded robot.

    Raises:
        ResultFileError: the file is damaged.
    """
    rows = [row for row in held_out.read(results)["rows"] if row["appearance"] == "source"]
    if not rows:
        return NOTHING
    head = ("planner", "stage", "ADE mm", "FDE mm", "path mm", "rotation deg (median)", "last yaw more than 45 deg off")
    return _markdown(head, map(_errors, rows))


def encoder_table(results: Path) -> str:
    """What the search for the smallest encoder measured, in its order.

    Raises:
        ResultFileError: the file is damaged.
    """
    path = results / encoders.NAME
    if not path.exists():
        return NOTHING
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
        texts = [_encoder(row) for row in rows]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultFileError(f"{path} is damaged ({error!r}); delete it and measure again") from error
    head = ("encoder", "pool", "steps", "seed", "planner MB", "a plan, ms", "ADE mm", "FDE mm", "rotation deg")
    return _markdown(head, texts)


def policy_table(table: PolicyTable, results: Path) -> str:
    """One of the paper's tables of policies.

    Raises:
        ResultFileError: the file is damaged.
    """
    rows = table.read(results)
    if not rows:
        return NOTHING
    head = (
        "policy",
        "plan",
        "steps x batch",
        "best checkpoint %",
        "of",
        "last five %",
        "95 % interval",
        "seeds",
        "published best %",
    )
    return _markdown(head, map(_policy, rows))


def _policy(row: Mapping[str, Any]) -> list[str]:
    low, high = row["last5_interval"]
    published, several = row["published_best"], len(row["seeds"]) > 1
    best, last = (f" ± {row[f'{name}_std']:.1f}" if several else "" for name in ("best", "last5"))
    return [
        f"{row['algorithm'].upper()} ({row['observation']})",
        str(VARIANTS[row["kind"]]) if row["kind"] else "none",
        ", ".join(row["budgets"]),
        f"**{row['best_mean']:.1f}**{best} ({', '.join(format(one['best'], '.0f') for one in row['seeds'])})",
        str(max(row["checkpoints"])),
        f"{row['last5_mean']:.1f}{last}",
        f"{low:.1f}-{high:.1f}",
        str(len(row["seeds"])),
        "" if published is None else f"{published[0]:.1f} ± {published[1]:.1f}",
    ]


def _encoder(row: Mapping[str, Any]) -> list[str]:
    return [
        "ResNet18" if row["encoder"] == "resnet18" else "-".join(map(str, row["channels"])),
        row["pool"].replace("_", " "),
        str(row["predictor_steps"] + row["finetune_steps"]),
        str(row["seed"]),
        f"{row['bytes'] / 1e6:.1f}",
        f"{row['plan_ms']:.2f}",
        *(f"{row[name]:.1f}" for name in ("ade_mm", "fde_mm", "rotation_deg")),
    ]


def _errors(row: Mapping[str, Any]) -> list[str]:
    posed = "rotation_deg" in row
    return [
        f"{row['observe']}, H = {row['horizon']}, {row['outputs']}, seed {row['seed']}",
        f"{row['candidate']}{' (kept)' if row['kept'] else ''}",
        *(f"{row[name]:.1f}" for name in ("ade_mm", "fde_mm", "path_mm")),
        f"{row['rotation_deg']:.1f} ({row['rotation_median_deg']:.1f})" if posed else "",
        f"{row['yaw_wrong_percent']:.1f} %" if posed else "",
    ]


def _read(folder: Path) -> list[TransferResult]:
    return [read_result(path) for path in sorted(folder.glob("*.json"))]


def _cells(
    results: Iterable[TransferResult],
    row: Callable[[TransferResult], tuple[str, ...]],
    column: Callable[[TransferResult], Hashable],
) -> dict[tuple[str, ...], dict[Any, str]]:
    """Row -> column -> the text of all training seeds."""
    entries: dict[tuple[str, ...], dict[Hashable, list[TransferResult]]] = defaultdict(lambda: defaultdict(list))
    for result in results:
        entries[row(result)][column(result)].append(result)
    return {key: {name: _cell(found) for name, found in line.items()} for key, line in entries.items()}


def _cell(results: Iterable[TransferResult]) -> str:
    by_seed = sorted(results, key=lambda result: -1 if result.planner_seed is None else result.planner_seed)
    counts = ", ".join(f"{result.successes}/{result.episodes}" for result in by_seed)
    if len(by_seed) == 1:
        return counts
    mean = sum(result.rate for result in by_seed) / len(by_seed)
    return f"**{100 * mean:.1f} %** ({counts})"


def _table(keys: Sequence[str], columns: Sequence[str], cells: Mapping[tuple[str, ...], Mapping[str, str]]) -> str:
    if not cells:
        return NOTHING
    return _markdown(
        [*keys, *columns], ([*key, *(row.get(name, "") for name in columns)] for key, row in cells.items())
    )


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", "| --- " * len(head) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])
