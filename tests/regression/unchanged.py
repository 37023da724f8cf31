"""Check that two versions of the package compute the same: record what each does, then compare.

    python tests/regression/unchanged.py record before --python OLD/.venv/bin/python --data square_ph.hdf5
    python tests/regression/unchanged.py record after --data square_ph.hdf5
    python tests/regression/unchanged.py compare before after

Both versions are driven by their command line alone, so that everything inside may have moved. On one machine, with the
same libraries, the following is the same to the last bit unless a change meant to alter it: collected and rendered
data, the weights of planners and policies trained for a few steps, labels, and episodes (outcome and steps) of every
task on every arm. Steps that are recorded already are not run again.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from safetensors import safe_open

VERBS = (
    *("collect", "demo", "doctor", "evaluate", "info", "label", "render", "report", "reproduce"),
    *("train-planner", "train-policy", "transfer", "view"),
)
PLANNERS = Path(__file__).parents[2] / "results" / "planners"
EPISODES = 10
ENVIRONMENTS = """
import warnings, gymnasium, ocplanner
from gymnasium.utils.env_checker import check_env
for task in ("Lift", "Can", "Square", "Stack", "ToolHang", "Transport"):
    env = gymnasium.make(f"ocplanner/{task}-v0", cameras=())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()
    print(task, "ok")
"""


class Recorder:
    """Runs the steps of one version in a folder."""

    def __init__(self, folder: Path, python: str, data: Path, episodes: int) -> None:
        self.folder, self.python, self.data, self.episodes = folder, python, data.absolute(), episodes
        folder.mkdir(parents=True, exist_ok=True)

    def record(self) -> None:
        """Run every step that is missing."""
        images, labelled, planner = "images.hdf5", "labelled.hdf5", "planner/planner.safetensors"
        for verb in VERBS:
            self._step(f"help_{verb}.txt", verb, "--help", keep_output=True)
        self._step("collected.hdf5", "collect", "--out", "collected.hdf5", "--episodes", "4", "--seed", "3")
        self._step(images, "render", str(self.data), images, "--limit", "6", "--workers", "1")
        steps = [f"--{stage}-steps=200" for stage in ("vae", "predictor", "finetune")]
        self._step(planner, "train-planner", "--data", images, "--run", "planner", *steps)
        rewards = ["--reward", "augment", "--form", "exp", "--horizon-step", "1", "5"]
        square = ["--planner", str(PLANNERS / "square_masked_h20_pose_0.safetensors")]
        self._step(labelled, "label", images, labelled, *square, *rewards)
        bc = ["--data", labelled, "--algorithm", "bc", "--observations", "image", "--cameras", "agentview"]
        bc += ["--hint", *self._horizons()]
        self._step("bc/policy.safetensors", "train-policy", *bc, "--mask", "all", "--run", "bc", "--steps", "20")
        bcq = ["--data", labelled, "--algorithm", "bcq", "--mask", "all", "--run", "bcq", "--steps", "60"]
        self._step("bcq/policy.safetensors", "train-policy", *bcq)
        evaluated = ["--policy", "bc/policy.safetensors", *square, "--episodes", "2", "--horizon", "120"]
        self._step("evaluation.json", "evaluate", *evaluated, "--out", "evaluation.json")
        cells = ["--planners", str(PLANNERS), "--episodes", str(self.episodes), "--workers", "2"]
        self._step("matrix.json", *self._matrix(), *cells, "--out", "matrix.json")
        self._python("environments.txt", ENVIRONMENTS)

    def _horizons(self) -> list[str]:
        """An older version wants to be told what the labels say."""
        shown = (self.folder / "help_train-policy.txt").read_text(encoding="utf-8")
        return ["--hint-horizons", "1", "5"] if "--hint-horizons" in shown else []

    def _matrix(self) -> list[str]:
        """The verb; an older version has it as a flag."""
        shown = (self.folder / "help_transfer.txt").read_text(encoding="utf-8")
        return ["transfer", "--matrix"] if "--matrix" in shown else ["matrix"]

    def _step(self, made: str, *arguments: str, keep_output: bool = False) -> None:
        self._run(made, [self.python, "-m", "ocplanner", *arguments], keep_output)

    def _python(self, made: str, program: str) -> None:
        self._run(made, [self.python, "-c", program], keep_output=True)

    def _run(self, made: str, command: list[str], keep_output: bool) -> None:
        path = self.folder / made
        if path.exists():
            return
        environment = {**os.environ, "COLUMNS": "100", "OCPLANNER_SIMD": os.environ.get("OCPLANNER_SIMD", "")}
        if not environment["OCPLANNER_SIMD"]:
            del environment["OCPLANNER_SIMD"]
        done = subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stderr[-4000:]}")
        if keep_output:
            path.write_text(done.stdout, encoding="utf-8")
        sys.stdout.write(f"recorded {made}\n")
        sys.stdout.flush()


def digests(path: Path) -> Iterator[tuple[str, str]]:
    """(name, digest) of everything in a recorded file that must stay as it is."""
    if path.suffix == ".hdf5":
        with h5py.File(path) as file:
            arrays: dict[str, np.ndarray] = {}
            file.visititems(
                lambda name, item: arrays.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None
            )
        yield from ((name, _digest(array)) for name, array in arrays.items())
    elif path.suffix == ".safetensors":
        with safe_open(path, framework="np") as file:
            yield from ((name, _digest(file.get_tensor(name))) for name in file.keys())  # noqa: SIM118
    elif path.suffix == ".json":
        yield from _episodes(json.loads(path.read_text(encoding="utf-8")))
    else:
        yield path.name, path.read_text(encoding="utf-8")


def _digest(array: np.ndarray) -> str:
    if array.dtype == object:
        return repr(array.tolist())
    return f"{array.dtype}{array.shape} {hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()}"


def _episodes(content: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for part in content.get("cells") or content.get("checkpoints") or [content]:
        name = f"{part.get('task', part.get('step'))} {part.get('robot', '')}"
        for run in part["runs"]:
            yield f"{name} seed {run['seed']}", f"{run['success']} {run['failure']} after {run['steps']} steps"


def compare(before: Path, after: Path) -> bool:
    """Print what differs between two recordings, file by file; whether nothing does (the text of --help apart)."""
    same = True
    for path in sorted(file for file in before.rglob("*") if _compared(file.relative_to(before))):
        name = path.relative_to(before)
        if not (after / name).exists():
            sys.stdout.write(f"{name}: missing\n")
            same = False
            continue
        old, new = dict(digests(path)), dict(digests(after / name))
        changed = sorted(key for key in {*old, *new} if old.get(key) != new.get(key))
        sys.stdout.write(f"{name}: {len(old) - len([key for key in changed if key in old])} of {len(old)} the same\n")
        for key in changed if path.suffix != ".txt" else []:
            sys.stdout.write(f"  {key}: {old.get(key, 'absent')} -> {new.get(key, 'absent')}\n")
        same = same and (not changed or name.name.startswith("help_"))
    return same


def _compared(name: Path) -> bool:
    recorded = {"policy.safetensors", "planner.safetensors", "evaluation.json", "matrix.json"}
    return name.suffix in (".hdf5", ".txt") or name.name in recorded


def main() -> None:
    """Record or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    record = verbs.add_parser("record")
    record.add_argument("folder", type=Path)
    record.add_argument("--python", default=sys.executable)
    record.add_argument("--data", type=Path, required=True)
    record.add_argument("--episodes", type=int, default=EPISODES)
    comparison = verbs.add_parser("compare")
    comparison.add_argument("before", type=Path)
    comparison.add_argument("after", type=Path)
    arguments = parser.parse_args()
    if arguments.verb == "record":
        Recorder(arguments.folder, arguments.python, arguments.data, arguments.episodes).record()
    elif not compare(arguments.before, arguments.after):
        sys.exit(1)


if __name__ == "__main__":
    main()
