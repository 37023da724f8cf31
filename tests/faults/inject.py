"""Faults injected into every verb that writes: is anything lost, and does each end in a clear error?

Run from the repository's root: ``python tests/faults/inject.py --output results/faults.json``. Each try is a process
of its own on tiny data, forked from this one (see ``process.py``), with one worker; its whole process group is killed.
A verb that was killed is started again until it is through. After each kill no visible file may be half-written and
nothing that was safe may be gone; at the end the folder must equal that of an undisturbed run, hidden files included:
byte for byte, or array for array where ``compared`` says so. Times in ``metrics.jsonl``, checkpoints and reports do
not count, nor TensorBoard's files; measured errors may differ by 1e-12 of their size, as between undisturbed runs.
Trainings write checkpoints more often than the command line would. The faults and what each must end in:
``interruptions.py`` and ``damage.py``. ``--verbs``, ``--faults`` and ``--tries`` choose a part; rows of other parts
stay in the output.
"""

import argparse
import json
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

os.environ.setdefault("OMP_NUM_THREADS", "1")

import damage
import interruptions
from bench import Bench
from machine import machine
from process import load
from rows import Row
from verbs import HDF5_READERS, PLANNER_READERS, POLICY_READERS, WRITERS, Material, Verb

from ocplanner.files.storage import atomic_json
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


def _chosen(options: argparse.Namespace, fault: Fault, verb: Verb) -> bool:
    return verb.name in options.verbs and (options.faults is None or fault.name in options.faults)


def main(arguments: Sequence[str] | None = None) -> int:
    """Inject, write the rows, and say whether all is well."""
    options = parse(arguments)
    chosen = [(fault, verb) for fault in FAULTS for verb in fault.verbs if _chosen(options, fault, verb)]
    load({module for _, verb in chosen for module in verb.modules})
    rows: list[Row] = []
    benches: dict[Verb, Bench] = {}
    # No TemporaryDirectory: the first forked process would clean it up.
    folder = Path(tempfile.mkdtemp(prefix="faults-"))
    try:
        material = Material(options.material or folder / "material")
        for fault, verb in chosen:
            bench = benches.setdefault(verb, Bench(folder, verb, material))
            bench.rng.seed(f"{options.seed} {verb.name} {fault.name}")
            row = Row(verb.name, fault.title)
            fault.inject(bench, row, options.tries or fault.tries)
            rows.append(row)
            print(row, *row.notes, sep="\n    ", flush=True)  # noqa: T201
            _write(options.output, options.seed, rows)
    finally:
        shutil.rmtree(folder)
    return int(any(row.lost or row.unclear for row in rows))


def _write(output: Path, seed: int, rows: Sequence[Row]) -> None:
    """Put these rows in place of those of the same verbs and faults, so that a run can be stopped or done in parts."""
    records = [row.record() for row in rows]
    fresh = {(record["verb"], record["fault"]) for record in records}
    kept = json.loads(output.read_text(encoding="utf-8"))["rows"] if output.exists() else []
    atomic_json(
        output,
        {
            "command": shlex.join(["python", "tests/faults/inject.py", "--seed", str(seed), "--output", str(output)]),
            "machine": machine(),
            "seed": seed,
            "versions": installed(),
            "rows": [record for record in kept if (record["verb"], record["fault"]) not in fresh] + records,
        },
    )


if __name__ == "__main__":
    sys.exit(main())
