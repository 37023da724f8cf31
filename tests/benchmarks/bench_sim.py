"""The simulation against stock robosuite: control steps with and without cameras, workers, whole episodes.

Run from the repository's root: ``python tests/benchmarks/bench_sim.py``. What each case compares stands in
``state_cases.py``, ``camera_cases.py`` and ``transfer_cases.py``. Rows of cases that are not run again stay; the table
in ``docs/simulation.md`` is rewritten.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import mujoco
from camera_cases import two_cameras, two_cameras_masked
from machine import machine_and_load
from sim_measured import SimMeasured, table
from state_cases import state_only
from transfer_cases import two_workers, whole_episode

from ocplanner.reproduction.markdown_tables import replace_tables

_OUTPUT = Path("results/bench_sim.json")
_PAGE = Path("docs/simulation.md")

CASES: dict[str, Callable[[int], SimMeasured]] = {
    "state panda": lambda steps: state_only("Panda", steps, drop_in=False),
    "state sawyer": lambda steps: state_only("Sawyer", steps, drop_in=False),
    "state panda, env.step": lambda steps: state_only("Panda", steps, drop_in=True),
    "state sawyer, env.step": lambda steps: state_only("Sawyer", steps, drop_in=True),
    "two cameras panda": lambda steps: two_cameras("Panda", steps // 2),
    "two cameras panda masked": lambda steps: two_cameras_masked("Panda", steps),
    "workers 2": lambda steps: two_workers(max(4, steps // 20)),
    "zero-shot episode sawyer": lambda steps: whole_episode(max(1, steps // 80)),
}


def main() -> None:
    """Measure the cases asked for and write them beside the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=list(CASES))
    parser.add_argument("--steps", type=int, default=400, help="control steps to measure per case and side")
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    source = {
        "machine": f"{machine_and_load()}, mujoco {mujoco.__version__}",
        "command": f"python tests/benchmarks/bench_sim.py --steps {options.steps}",
    }
    rows = {case: {**CASES[case](options.steps).row(case), **source} for case in options.cases}
    earlier = json.loads(options.output.read_text())["rows"] if options.output.exists() else []
    merged = {row["case"]: row for row in earlier} | rows
    options.output.parent.mkdir(parents=True, exist_ok=True)
    result = {**source, "rows": list(merged.values())}
    options.output.write_text(json.dumps(result, indent=1) + "\n")
    if options.output == _OUTPUT:
        _PAGE.write_text(replace_tables(_PAGE.read_text(), {"BENCH": table(result["rows"])}, _PAGE))
    for row in rows.values():
        print(f"{row['case']}: {row['ours']} {row['unit']}, ratio {row['ratio']}")  # noqa: T201


if __name__ == "__main__":
    main()
