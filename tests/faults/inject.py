"""Faults injected into every verb that writes: is anything lost, and does each end in a clear error?

Run from the repository's root: ``python tests/faults/inject.py --output results/faults.json``. Each try is a process
of its own on tiny data, forked from this one (see ``process.py``), with one worker; its whole process group is killed.
A verb that was killed is started again until it is through. After each kill no visible file may be half-written and
nothing that was safe may be gone; at the end the folder must equal that of an undisturbed run, hidden files included:
byte for byte, or array for array where ``compared`` says so. Times in ``metrics.jsonl``, checkpoints and reports do
not count, nor TensorBoard's files. Trainings write checkpoints more often than the command line would. The faults and
what each must end in: ``interruptions.py`` and ``damage.py``.
"""

import argparse
import os
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

os.environ.setdefault("OMP_NUM_THREADS", "1")

import damage
import interruptions
from bench import Bench
from machine import machine_and_load
from process import load_everything
from rows import Row
from verbs import HDF5_READERS, PLANNER_READERS, POLICY_READERS, WRITERS, Material, Verb

from ocplanner.storage import atomic_json
from ocplanner.versions import installed


@dataclass(frozen=True)
class Fault:
    """A fault, what injects it, how often if nothing else is asked for, and into which verbs."""

    name: str
    inject: Callable[[Bench, Row, int], None]
    tries: int
    verbs: Sequence[Verb]
    title: str


FAULTS = (
    Fault("kill", interruptions.kill_at_random, 50, WRITERS, "kill -9 at a random moment"),
    Fault("checkpoint", damage.damaged_checkpoint, 8, WRITERS, "damaged checkpoint"),
    Fault("disk-full", interruptions.full_disk, 4, WRITERS, "disk full"),
    Fault("truncated", damage.truncated_data, 100, HDF5_READERS, "truncated HDF5"),
    Fault("hostile-planner", damage.hostile_planner, 40, PLANNER_READERS, "hostile planner file"),
    Fault("hostile-policy", damage.hostile_policy, 40, POLICY_READERS, "hostile policy file"),
    Fault("read-only", interruptions.read_only, 3, WRITERS, "read-only folder"),
    Fault("two-processes", interruptions.two_processes, 3, WRITERS, "two processes on one output"),
    Fault("kill-writing", interruptions.kill_while_writing, 10, WRITERS, "kill -9 while it writes"),
)
VERBS = tuple(dict.fromkeys(verb.name for fault in FAULTS for verb in fault.verbs))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--verbs", nargs="+", choices=VERBS, default=VERBS)
    parser.add_argument("--faults", nargs="+", choices=[fault.name for fault in FAULTS])
    parser.add_argument("--tries", type=int, help="of each fault, instead of its own number")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--material", type=Path, help="keep the inputs here, for further runs")
    parser.add_argument("--output", type=Path, required=True)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Inject, write the rows, and say whether all is well."""
    options = parse(arguments)
    load_everything()
    started = time.monotonic()
    rows: list[Row] = []
    benches: dict[Verb, Bench] = {}
    folder = Path(
        tempfile.mkdtemp(prefix="faults-")
    )  # no TemporaryDirectory: the first forked process would clean it up
    try:
        material = Material(options.material or folder / "material")
        for fault in FAULTS:
            if fault.name not in (options.faults or fault.name):
                continue
            for verb in fault.verbs:
                if verb.name not in options.verbs:
                    continue
                bench = benches.setdefault(verb, Bench(folder, verb, material))
                bench.rng.seed(f"{options.seed} {verb.name} {fault.name}")
                row = Row(verb.name, fault.title)
                fault.inject(bench, row, options.tries or fault.tries)
                rows.append(row)
                print(row, *row.notes, sep="\n    ", flush=True)  # noqa: T201
                _write(options, time.monotonic() - started, rows)
    finally:
        shutil.rmtree(folder)
    return int(any(row.lost or row.unclear for row in rows))


def _write(options: argparse.Namespace, seconds: float, rows: Sequence[Row]) -> None:
    """The rows so far, so that a run that is stopped leaves what it found."""
    chosen = {"--verbs": options.verbs if options.verbs != VERBS else (), "--faults": options.faults or ()}
    flags = [word for flag, words in chosen.items() if words for word in (flag, *words)]
    flags += ["--tries", str(options.tries)] if options.tries else []
    command = ["python", "tests/faults/inject.py", *flags, "--seed", str(options.seed)]
    atomic_json(
        options.output,
        {
            "command": shlex.join([*command, "--output", "results/faults.json"]),
            "machine": machine_and_load(),
            "minutes": round(seconds / 60, 1),
            "seed": options.seed,
            "versions": installed(),
            "rows": [row.record() for row in rows],
        },
    )


if __name__ == "__main__":
    sys.exit(main())
