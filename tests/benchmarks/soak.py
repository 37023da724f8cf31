"""Thousands of short episodes through two workers: does anything grow?

Run from the repository's root: ``python tests/benchmarks/soak.py``. Each episode is a reset and tens of control steps
with random actions and two masked 84x84 pictures each; every so often a worker closes its environment and makes a new
one. After each episode the resident memory, open files, threads, OpenGL contexts and environments of its worker are
noted, and those of this process with the number of its children (the workers and multiprocessing's own tracker).

``slope`` is the least-squares growth of memory over a process's own episodes in KiB per 100, without the start-up: the
first fifth, and the first two environments, since the second raises the allocator's high-water mark. Making further
ones moves the memory by some MiB to and fro: a slope means little before several hundred episodes. The other numbers
are the least and the most that were seen after the start-up. This process keeps the samples, about 1 KiB an episode.
"""

import argparse
import gc
import json
import multiprocessing.resource_tracker
import os
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from machine import machine

from ocplanner.envs import ManipulationEnv, make_env, rendering
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.versions import installed

_OUTPUT = Path("results/soak.json")
_WORKERS = 2
_SAMPLES_KEPT = 200
_LABELS = ("pid", "episodes")
_REPORT_S = 30.0
_PAGE_KIB = os.sysconf("SC_PAGE_SIZE") // 1024

Sample = dict[str, int]


class Place:
    """A worker's environment, closed and made again after every ``remake`` episodes."""

    def __init__(self, remake: int) -> None:
        self._remake = remake
        self._env: ManipulationEnv | None = None
        self._episodes = 0

    def play(self, steps: int, seed: int) -> Sample:
        if self._env is not None and self._episodes % self._remake == 0:
            self.close()
        if self._env is None:
            self._env = make_env("Square", cameras=("agentview", "robot0_eye_in_hand"), observe="masked")
        rng = np.random.default_rng(seed)
        self._env.reset(seed)
        for _ in range(steps):
            self._env.step(rng.uniform(-1, 1, self._env.action_dim))
            self._env.observe()
        self._episodes += 1
        alive = sum(isinstance(item, ManipulationEnv) for item in gc.get_objects())
        return {**own_use(), "contexts": len(rendering._open), "environments": alive, "episodes": self._episodes}

    def close(self) -> None:
        if self._env is not None:
            self._env.close()
            self._env = None


def play(steps: int, place: Place, seed: int) -> Sample:
    return place.play(steps, seed)


def own_use() -> Sample:
    """What this process holds: resident memory in KiB, open files, threads, children."""
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_KIB
    tasks = list(Path("/proc/self/task").iterdir())
    children = sum(len((task / "children").read_text().split()) for task in tasks)
    files = len(os.listdir("/proc/self/fd"))
    return {"pid": os.getpid(), "kib": resident, "files": files, "threads": len(tasks), "children": children}


def summary(samples: Sequence[Sample], startup: int) -> dict[str, Any]:
    """The slope, and the extremes of everything counted, of one process after so many episodes or a fifth of all."""
    settled = samples[max(startup, len(samples) // 5) :] or samples[-1:]
    columns = {key: np.array([sample[key] for sample in settled], dtype=np.float64) for key in settled[0]}
    slope = round(100 * float(np.polyfit(columns["episodes"], columns["kib"], 1)[0]), 1) if len(settled) > 1 else None
    counted = {key: [int(column.min()), int(column.max())] for key, column in columns.items() if key not in _LABELS}
    return {"slope": slope, "episodes": samples[-1]["episodes"], **counted}


def soak(episodes: int, steps: int, remake: int) -> dict[str, Any]:
    """Run it, with a line of progress now and then."""
    multiprocessing.resource_tracker.ensure_running()  # it stays until this process ends
    before = own_use()
    main: list[Sample] = []
    workers: dict[int, list[Sample]] = {}
    start = reported = time.monotonic()
    for _, sample in run_episodes(
        partial(Place, remake), partial(play, steps), range(episodes), WorkerSettings(_WORKERS)
    ):
        workers.setdefault(sample["pid"], []).append(sample)
        main.append({**own_use(), "episodes": len(main) + 1})
        if time.monotonic() - reported > _REPORT_S or len(main) == episodes:
            reported = time.monotonic()
            memory = ", ".join(f"{each[-1]['kib'] // 1024} MiB" for each in [main, *workers.values()])
            print(f"{len(main)} of {episodes} episodes in {reported - start:.0f} s: {memory}", flush=True)  # noqa: T201
    after = own_use()
    return {
        "seconds": round(time.monotonic() - start),
        "main": summary(main, 2 * remake),
        "workers": [summary(samples, 2 * remake) for samples in workers.values()],
        "left_over": {key: after[key] - before[key] for key in ("files", "threads", "children")},
        "samples": {
            "main": _thinned(main),
            **{f"worker {n}": _thinned(samples) for n, samples in enumerate(workers.values())},
        },
    }


def _thinned(samples: Sequence[Sample]) -> dict[str, list[int]]:
    kept = samples[:: max(1, len(samples) // _SAMPLES_KEPT)]
    return {key: [sample[key] for sample in kept] for key in kept[0] if key != "pid"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=30, help="control steps of an episode")
    parser.add_argument("--remake", type=int, default=20, help="episodes after which a worker remakes its environment")
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    found = soak(options.episodes, options.steps, options.remake)
    flags = f"--episodes {options.episodes} --steps {options.steps} --remake {options.remake}"
    result = {
        "machine": machine(),
        "command": f"python tests/benchmarks/soak.py {flags}",
        "versions": installed(),
        **found,
    }
    options.output.write_text(json.dumps(result, separators=(",", ": ")) + "\n")
    for name in ("main", "workers", "left_over"):
        print(f"{name}: {result[name]}")  # noqa: T201


if __name__ == "__main__":
    main()
