"""The table of zero-shot results, from the result files themselves."""

import json
from collections import defaultdict
from pathlib import Path


def transfer_table(folder: Path) -> str:
    """A Markdown table of every result file in ``folder``: one row a follow mode and observation, one column a robot.

    A cell lists the successes of each training seed in order, and their mean when there are several.
    """
    cells: dict[tuple[str, str], dict[str, list[tuple[int, int, int]]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted(folder.glob("*.json")):
        result = json.loads(path.read_text())
        entry = (result["planner_seed"], result["successes"], result["episodes"])
        cells[result["follow"], result["observe"]][result["robot"]].append(entry)
    robots = sorted({robot for row in cells.values() for robot in row})
    lines = [f"| follow | observe | {' | '.join(robots)} |", "| --- " * (len(robots) + 2) + "|"]
    for (follow, observe), row in sorted(cells.items()):
        texts = [_cell(sorted(row[robot])) if robot in row else "" for robot in robots]
        lines.append(f"| {follow} | {observe} | {' | '.join(texts)} |")
    return "\n".join(lines)


def _cell(entries: list[tuple[int, int, int]]) -> str:
    counts = ", ".join(f"{successes}/{episodes}" for _, successes, episodes in entries)
    if len(entries) == 1:
        return counts
    mean = sum(successes / episodes for _, successes, episodes in entries) / len(entries)
    return f"**{100 * mean:.0f} %** ({counts})"
