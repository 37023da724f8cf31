"""Control steps per second of ocplanner's environments against stock robosuite's, on Square.

Run from the repository's root: ``python tests/benchmarks/bench_sim.py``. Both sides share one model, the same actions
and the same starts, and take turns at every control step. A figure is 1 over the median time of a step; the time is the
calling thread's on the processor, which does all of the work, so that other processes disturb little. ``mujoco`` among
the peers is the bare physics, 25 ``mj_step`` from the states of our own steps with the commands held: a ratio below 1
is what the control loop still costs. Rows of cases that are not run again stay.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.envs.native_control import attach

_OUTPUT = Path("results/bench_sim.json")
_EPISODE = 100
_ACTION_SCALE = 0.3


def _timed(act: Callable[[], object]) -> float:
    start = time.thread_time()
    act()
    return time.thread_time() - start


def _state_only(robot: str, steps: int, *, drop_in: bool) -> dict[str, float]:
    """Seconds per control step of us, stock robosuite and the bare physics.

    Args:
        robot: the arm.
        steps: control steps to measure.
        drop_in: our side is robosuite's own ``env.step`` with all observations and the reward, made native;
            else a step of :class:`ManipulationEnv` with the poses and the verdict that a rollout reads.
    """
    ours, stock = (make_env("Square", robot, cameras=(), control=control) for control in ("native", "stock"))
    if attach(ours.robosuite_env) is None:
        raise SystemExit("the native control loop does not attach here: nothing to measure")

    def lean(action: np.ndarray) -> None:
        ours.step(action)
        ours.object_pose(), ours.eef_pose(), ours.success()

    step = ours.robosuite_env.step if drop_in else lean
    rng = np.random.default_rng(0)
    physics = mujoco.MjData(ours.model)
    times: dict[str, list[float]] = {"ours": [], "robosuite": [], "mujoco": []}
    for index in range(steps):
        if index % _EPISODE == 0:
            ours.reset(index)
            stock.reset(index)
        action = _ACTION_SCALE * rng.uniform(-1, 1, ours.action_dim)
        mujoco.mj_copyData(physics, ours.model, ours.data)
        sides = {
            "ours": lambda action=action: step(action),
            "robosuite": lambda action=action: stock.robosuite_env.step(action),
            "mujoco": lambda: mujoco.mj_step(ours.model, physics, nstep=25),
        }
        for name in rng.permutation(list(sides)):
            times[name].append(_timed(sides[name]))
    _check_same_place(ours, stock)
    ours.close()
    stock.close()
    return {name: float(np.median(values)) for name, values in times.items()}


def _check_same_place(ours: ManipulationEnv, stock: ManipulationEnv) -> None:
    apart = np.abs(ours.eef_pose().position - stock.eef_pose().position).max()
    if apart > 1e-3:
        raise SystemExit(f"the two simulations have parted by {apart:.1e} m: nothing to compare")


CASES: dict[str, Callable[[int], dict[str, float]]] = {
    "state panda": lambda steps: _state_only("Panda", steps, drop_in=False),
    "state sawyer": lambda steps: _state_only("Sawyer", steps, drop_in=False),
    "state panda, env.step": lambda steps: _state_only("Panda", steps, drop_in=True),
    "state sawyer, env.step": lambda steps: _state_only("Sawyer", steps, drop_in=True),
}


def _row(case: str, seconds: dict[str, float]) -> dict[str, Any]:
    ours = seconds.pop("ours")
    return {
        "case": case,
        "unit": "control steps/s",
        "ours": round(1 / ours, 1),
        "peers": {peer: round(1 / value, 1) for peer, value in seconds.items()},
        "ratio": {peer: round(value / ours, 2) for peer, value in seconds.items()},
    }


def _machine() -> str:
    names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    name = names[0].partition(":")[2].strip() if names else platform.processor()
    return f"{name}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, mujoco {mujoco.__version__}"


def main() -> None:
    """Measure the cases asked for and write them beside the others."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=list(CASES))
    parser.add_argument("--steps", type=int, default=400, help="control steps to measure per case and side")
    parser.add_argument("--output", type=Path, default=_OUTPUT)
    options = parser.parse_args()
    rows = {case: _row(case, CASES[case](options.steps)) for case in options.cases}
    earlier = json.loads(options.output.read_text())["rows"] if options.output.exists() else []
    merged = {row["case"]: row for row in earlier} | rows
    options.output.parent.mkdir(parents=True, exist_ok=True)
    result = {
        "machine": _machine(),
        "command": f"python tests/benchmarks/bench_sim.py --steps {options.steps}",
        "rows": list(merged.values()),
    }
    options.output.write_text(json.dumps(result, indent=1) + "\n")
    for row in rows.values():
        print(f"{row['case']}: {row['ours']} {row['unit']}, ratio {row['ratio']}")  # noqa: T201


if __name__ == "__main__":
    main()
