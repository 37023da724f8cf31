"""``ocplanner label --reward augment`` against the same job written with h5py, torch and NumPy, and its memory.

Run from the repository's root, after ``ocplanner render square_ph.hdf5 masked.hdf5``:
``python tests/benchmarks/bench_label.py --data square_ph.hdf5 --pictures masked.hdf5``. One thread. Whole jobs take
turns in one process: files are read, planned on, written and put in their places. Ours checks its input and can be
stopped at any moment; the other does neither. They are timed with the planner that is given and with a ResNet18 of
random weights, whose rewards mean nothing but must agree as well. Memory is that of new processes which label a tenth
of the file, the file, and one ten times as long, made of the same demonstrations under further names.
"""

import argparse
import json
import shlex
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

sys.path.append(str(Path(__file__).parents[1]))  # random planner files are made by tests/random_planner.py

from cases import RESNET18
from machine import machine_and_load
from planner_weights import PlannerWeights
from timing import interleaved
from torch_labels import TorchLabeller

from ocplanner.demos.dataset import Demonstrations
from ocplanner.files.storage import atomic_json
from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.settings import LabelSettings
from ocplanner.planner.planner import Planner
from ocplanner.versions import installed
from random_planner import write_random_planner

# The kernel counts a child's peak from its parent's size on, but VmHWM from its own start.
_PEAK = """
import re, sys
from ocplanner.cli import main
status = main(sys.argv[1:])
print(re.search("VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])
sys.exit(status)
"""
_SETTINGS = LabelSettings(hints=False, reward="augment")


def _ours(planner: Planner, source: Path, pictures: Path, target: Path, limit: int | None) -> None:
    label_dataset(source, target, planner, _SETTINGS, pictures=pictures, limit=limit, overwrite=True)


def speed(planner: Path, source: Path, pictures: Path, demos: int, seconds: float) -> dict[str, Any]:
    """Transitions a second of whole jobs, and how many times as long the peers take; their rewards must agree."""
    torch.set_num_threads(1)
    with Demonstrations(source) as recorded, tempfile.TemporaryDirectory() as folder:
        names, loaded, weights = list(recorded.names[:demos]), Planner.load(planner), PlannerWeights.load(planner)
        transitions = sum(recorded[name].length for name in names)
        targets = {name: Path(folder, f"{name}.hdf5") for name in ("ours", "torch", "torch as trained")}
        sides = {"ours": partial(_ours, loaded, source, pictures, targets["ours"], len(names))}
        for name, as_trained in (("torch", False), ("torch as trained", True)):
            peer = TorchLabeller(weights, as_trained=as_trained)
            sides[name] = partial(peer.label, source, pictures, targets[name], names)
        timings = interleaved(sides, seconds)
        apart = max(_difference(targets["ours"], targets[peer], names) for peer in ("torch", "torch as trained"))
    if apart > 1e-6:
        raise SystemExit(f"the rewards differ by {apart}: this compares two different jobs")
    mine = timings.pop("ours")
    return {
        "unit": "transitions a second",
        "ours": round(transitions / mine.median),
        "peers": {name: round(transitions / timing.median) for name, timing in timings.items()},
        "ratio": {name: round(timing.median / mine.median, 2) for name, timing in timings.items()},
        "transitions": transitions,
        "rounds": mine.rounds,
        "largest difference of rewards": apart,
    }


def _difference(ours: Path, theirs: Path, names: list[str]) -> float:
    with h5py.File(ours) as mine, h5py.File(theirs) as other:
        pairs = ((mine[f"data/{name}/rewards"][:], other[f"data/{name}/rewards"][:]) for name in names)
        return float(max(np.abs(first - second).max() for first, second in pairs))


def longer(source: Path, target: Path, times: int) -> Path:
    """A file with every demonstration so many times, under names of their own; the data stand in it once."""
    with h5py.File(source) as read, h5py.File(target, "w") as write:
        data = write.create_group("data")
        data.attrs.update(read["data"].attrs)
        names = list(read["data"])
        for index, name in enumerate(names):
            read.copy(f"data/{name}", data, name=f"demo_{index}")
            for again in range(1, times):
                data[f"demo_{index + again * len(names)}"] = data[f"demo_{index}"]
    return target


def memory(planner: Path, source: Path, pictures: Path, limit: int | None, folder: Path) -> dict[str, Any]:
    """Peak memory of a new process that labels a file."""
    with Demonstrations(source) as recorded:
        demos = len(recorded.names[:limit])
    flags = ["--planner", planner, "--pictures", pictures, "--no-hints", "--reward", "augment", "--overwrite"]
    flags += [] if limit is None else ["--limit", str(limit)]
    command = [sys.executable, "-c", _PEAK, "label", source, folder / "labelled.hdf5", *flags]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{shlex.join(map(str, command))} failed")
    return {"demonstrations": demos, "peak MiB": int(done.stdout.split()[-1]) // 1024}


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("square_ph.hdf5"))
    parser.add_argument("--pictures", type=Path, required=True, help="its images, drawn as the planner saw them")
    parser.add_argument("--planner", type=Path, default=Path("results/planners/square_masked_h20_pose_0.safetensors"))
    parser.add_argument("--demos", type=int, default=20, help="demonstrations of a timed job")
    parser.add_argument("--seconds", type=float, default=60.0, help="of timing")
    parser.add_argument("--times", type=int, default=10, help="how many times as long the longest file is")
    parser.add_argument("--output", type=Path, default=Path("results/bench_label.json"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        resnet18 = Path(scratch, "resnet18.safetensors")
        seen = Planner.load(options.planner).header
        write_random_planner(resnet18, **RESNET18, observe=seen.observe, visual=seen.visual, mask_rgb=seen.mask_rgb)
        timed = [
            {"case": case, **speed(planner, options.data, options.pictures, options.demos, options.seconds)}
            for case, planner in {
                f"whole job, {options.planner.stem}": options.planner,
                "whole job, resnet18": resnet18,
            }.items()
        ]
    print(json.dumps(timed), flush=True)  # noqa: T201
    with tempfile.TemporaryDirectory() as scratch, Demonstrations(options.data) as recorded:
        folder = Path(scratch)
        tenth = max(len(recorded) // options.times, 1)
        rows = [memory(options.planner, options.data, options.pictures, limit, folder) for limit in (tenth, None)]
        data = longer(options.data, folder / "data.hdf5", options.times)
        pictures = longer(options.pictures, folder / "pictures.hdf5", options.times)
        rows.append(memory(options.planner, data, pictures, None, folder))
    print(json.dumps(rows), flush=True)  # noqa: T201
    result = {
        "machine": machine_and_load(),
        "command": shlex.join(["python", "tests/benchmarks/bench_label.py", *sys.argv[1:]]),
        "versions": installed(),
        "rows": timed,
        "memory": rows,
    }
    atomic_json(options.output, result)


if __name__ == "__main__":
    main()
