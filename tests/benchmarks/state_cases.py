"""Control steps without cameras.

Both sides share one process, one model, the same actions and the same starts, and take turns at every control step.
The time is the calling thread's on the processor, which does all of the work, so that other processes disturb little.
``mujoco`` among the peers is the bare physics, 25 ``mj_step`` from the states of our own steps with the commands held:
a ratio below 1 is what the control loop still costs.
"""

import time
from collections.abc import Callable

import mujoco
import numpy as np
from sim_measured import SimMeasured

from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.envs.native_control import attach

_EPISODE = 100
_ACTION_SCALE = 0.3


def state_only(robot: str, steps: int, *, drop_in: bool) -> SimMeasured:
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
    seconds = {name: float(np.median(values)) for name, values in times.items()}
    return SimMeasured(seconds, "control steps/s", "median of the calling thread's processor time")


def _timed(act: Callable[[], object]) -> float:
    start = time.thread_time()
    act()
    return time.thread_time() - start


def _check_same_place(ours: ManipulationEnv, stock: ManipulationEnv) -> None:
    apart = np.abs(ours.eef_pose().position - stock.eef_pose().position).max()
    if apart > 1e-3:
        raise SystemExit(f"the two simulations have parted by {apart:.1e} m: nothing to compare")
