"""From raw robosuite recordings of a UR5e to a planner that drives a Panda: ``results/raw_recordings.json``.

Ten scripted demonstrations of Lift are stripped to what robosuite's own recorder writes: states, actions, and no pose.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from ocplanner.versions import installed

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from test_raw import to_raw

RESULT = Path("results/raw_recordings.json")


def _run(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "ocplanner", *map(str, arguments)], check=True)


def main() -> None:
    """Collect, strip, render, train and transfer; what is there already is not made again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("runs/raw"))
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    work = given.work
    work.mkdir(parents=True, exist_ok=True)
    whole, raw, images = (work / name for name in ("whole.hdf5", "raw.hdf5", "images.hdf5"))
    planner, result = work / "planner" / "planner.safetensors", work / "panda.json"
    if not whole.exists():
        _run("collect", "--task", "Lift", "--robot", "UR5e", "--episodes", 10, "--out", whole)
    if not raw.exists():
        to_raw(whole, raw)
    if not images.exists():
        _run("render", raw, images, "--workers", 1)
    if not planner.exists():
        _run("train-planner", "--data", images, "--run", planner.parent)
    if not result.exists():
        _run("transfer", "--planner", planner, "--robot", "Panda", "--episodes", 20, "--workers", 1, "--out", result)
    found = json.loads(result.read_text())
    episodes = found["runs"]
    row = {
        "recorded": "10 scripted demonstrations of Lift by a UR5e, stripped to states and actions",
        "robot": "Panda",
        "seeds": [run["seed"] for run in episodes],
        "successes": sum(run["success"] for run in episodes),
        "episodes": len(episodes),
        "privileged": found["privileged"],
        "planner_sha256": found["planner_sha256"],
    }
    command = "python tests/benchmarks/raw_recordings.py"
    given.out.write_text(json.dumps({"command": command, "versions": installed(), "rows": [row]}, indent=2) + "\n")
    sys.stdout.write(f"{row['successes']} of {row['episodes']} on {row['robot']}\n")


if __name__ == "__main__":
    main()
