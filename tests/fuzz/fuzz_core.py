"""Fuzzes every function and class of ``ocplanner._core``, the loader of planner files above all.

Run from the repository's root: ``python tests/fuzz/fuzz_core.py --seconds 600``. A call may return its result, or raise
an error of ``ocplanner.errors`` or a TypeError. It must not panic, crash, hang, or exceed the memory limit. The current
input is kept in ``--folder`` as ``current``, so that one that kills the process can be replayed:
``python tests/fuzz/fuzz_core.py --replay FILE``. Where atheris is installed, ``--atheris`` lets it choose the inputs by
the coverage of the Python side; otherwise they are random, from ``--seed``.
"""

import argparse
import faulthandler
import os
import random
import resource
import sys
import time
import warnings
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[1]))  # random planner files are made by tests/random_planner.py

from choices import Choices
from targets import TARGETS

from ocplanner.errors import OcplannerError

_CALLERS = [(name, caller) for name, callers in TARGETS.items() for caller in callers]
_LOADER = 2
"""One input in so many goes to the target of planner files, besides its ordinary share."""
_MOST_MEMORY = 4 << 30
_HANGS_S = 30
_LONGEST = 160


def one_input(data: bytes) -> None:
    """Make the one call that the bytes describe.

    Raises:
        BaseException: any exception other than a TypeError or an error of ``ocplanner.errors``.
    """
    choices = Choices(data)
    _, caller = choices.pick(_CALLERS)
    try:
        caller(choices)
    except (OcplannerError, TypeError):
        return


def random_input(rng: random.Random) -> bytes:
    """Random bytes. Some always go to the loader of planner files, and some are mostly harmless choices."""
    data = bytearray(rng.randbytes(rng.randint(1, _LONGEST)))
    if rng.random() < 0.5:
        data = bytearray(byte if rng.random() < 0.3 else 0 for byte in data)
    data[0] = 0 if rng.random() < 1 / _LOADER else rng.randrange(256)
    return bytes(data)


def main() -> None:
    """Fuzz for some time, or replay inputs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("runs/fuzz"))
    parser.add_argument("--replay", type=Path, nargs="*", help="files to run once each, instead of fuzzing")
    parser.add_argument("--atheris", action="store_true")
    options = parser.parse_args()
    replayed = [path.resolve() for path in options.replay or ()]
    options.folder.mkdir(parents=True, exist_ok=True)
    os.chdir(options.folder)  # MuJoCo writes its log to where it runs
    warnings.simplefilter("ignore")
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    if options.replay is not None:
        for path in replayed:
            print(path)  # noqa: T201
            _watched(path.read_bytes())
    elif options.atheris:
        _fuzz_with_atheris(options.seconds)
    else:
        _fuzz(options.seconds, options.seed)


def _watched(data: bytes) -> None:
    faulthandler.dump_traceback_later(_HANGS_S, exit=True)
    try:
        one_input(data)
    finally:
        faulthandler.cancel_dump_traceback_later()


def _fuzz(seconds: float, seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 (not for secrets)
    end = time.monotonic() + seconds
    current = Path("current")
    count = failures = 0
    slowest = 0.0
    while time.monotonic() < end:
        data = random_input(rng)
        current.write_bytes(data)
        start = time.monotonic()
        try:
            _watched(data)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            failures += 1
            Path(f"failed_{failures}").write_bytes(data)
            print(f"failed_{failures}: {type(error).__name__}: {str(error)[:300]}", flush=True)  # noqa: T201
        if time.monotonic() - start > slowest:
            slowest = time.monotonic() - start
            Path("slowest").write_bytes(data)
        count += 1
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{count} inputs, {failures} failures, slowest {slowest:.2f} s, {peak:.0f} MiB at most")  # noqa: T201
    sys.exit(failures > 0)


def _fuzz_with_atheris(seconds: float) -> None:
    import atheris

    atheris.instrument_all()
    limits = [f"-max_total_time={int(seconds)}", f"-timeout={_HANGS_S}", "-rss_limit_mb=4096", f"-max_len={_LONGEST}"]
    atheris.Setup([sys.argv[0], *limits], one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
