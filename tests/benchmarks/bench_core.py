"""The Rust engine against torch, torch.compile, onnxruntime and OpenVINO, on the same weights and the same images.

Run from the repository's root: ``python tests/benchmarks/bench_core.py``. Each case runs in its own process, where all
sides take turns call by call, in random order. A figure is the median wall-clock time of one call; a ratio is a peer's
time over ours. All sides must agree on the plans before anything is timed. ``--simd avx2`` measures our engine without
AVX-512, in separate rows; the peers keep their best instruction set. Rows of cases not run again stay as they are.
"""

import argparse
import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # random planner files are made by tests/random_planner.py

import rows
from cases import CASES, DeltaPoseCase, DisagreementError, Measured
from peers import PEERS, versions
from timing import Timing

_OUTPUT = Path("results/bench_core.json")
_PAGES = (Path("docs/performance.md"), Path("README.md"))
_CHART = Path("docs/images/bench_core.png")


def main() -> None:
    """Measure the chosen cases, and write them beside the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=list(CASES), metavar="CASE")
    parser.add_argument("--list", action="store_true", help="print the cases and stop")
    parser.add_argument("--skip", nargs="*", choices=list(PEERS), default=[], help="peers to leave out")
    parser.add_argument(
        "--simd",
        nargs="*",
        choices=["best", *rows.LEVELS],
        default=["best"],
        help="instruction sets for our engine; any but best adds its name to the case",
    )
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="how long to measure each case; at least 15 rounds are made"
    )
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    parser.add_argument("--in-process", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.list:
        print("\n".join(CASES))  # noqa: T201
        return
    if options.in_process:
        _measure_here(options.cases[0], options.seconds, options.skip)
        return
    found = {}
    for level in options.simd:
        for case in options.cases:
            if level != "best" and isinstance(CASES[case], DeltaPoseCase):
                continue  # float64 without vector instructions of ours: the same at every level
            measured = _measure(case, level, options.seconds, options.skip)
            name = case if level == "best" else f"{case} {level}"
            found[name] = rows.row(name, CASES[case].unit, measured)
            print(f"{name}: {found[name]['ours']} {found[name]['unit']}, ratio {found[name]['ratio']}")  # noqa: T201
            for peer, reason in measured.absent.items():
                print(f"  without {peer}: {reason}")  # noqa: T201
    command = f"python tests/benchmarks/bench_core.py --simd {' '.join(options.simd)} --seconds {options.seconds:g}"
    merged = rows.write(options.output, found, command, versions())
    if options.output == _OUTPUT:
        rows.chart(merged, _CHART)
        for page in _PAGES:
            rows.insert(page, rows.table(merged))


def _measure(case: str, level: str, seconds: float, skip: list[str]) -> Measured:
    """Run one case in its own process: the engine reads OCPLANNER_SIMD only once, and cases must not share threads."""
    command = [sys.executable, __file__, "--in-process", "--cases", case, "--seconds", str(seconds), "--skip", *skip]
    environment = {**os.environ, "OMP_NUM_THREADS": str(getattr(CASES[case], "threads", 1))}
    environment.pop("OCPLANNER_SIMD", None)
    if level != "best":
        environment["OCPLANNER_SIMD"] = level
    run = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{case}: not measured, see above")
    result = json.loads(run.stdout.splitlines()[-1])
    if level not in ("best", result["simd"]):
        raise SystemExit(f"{case}: this processor has no {level}, the engine used {result['simd']}")
    timings = {name: Timing(**values) for name, values in result["timings"].items()}
    return Measured(timings, result["absent"])


def _measure_here(case: str, seconds: float, skip: list[str]) -> None:
    from ocplanner import _core

    try:
        measured = CASES[case].measure(seconds, skip)
    except DisagreementError as error:
        raise SystemExit(f"{case}: {error}: nothing to compare") from None
    print(json.dumps({"simd": _core.simd_level(), **dataclasses.asdict(measured)}))  # noqa: T201


if __name__ == "__main__":
    main()
