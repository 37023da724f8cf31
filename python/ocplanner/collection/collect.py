"""Recording scripted demonstrations, or failures, as a robomimic data set."""

import json
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ocplanner.collection.expert import demonstrate
from ocplanner.collection.experts import expert_of
from ocplanner.collection.flawed import fail
from ocplanner.collection.settings import Flaw
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.environment import ManipulationEnv, make_env
from ocplanner.envs.robots import robot as robot_spec
from ocplanner.envs.tasks import task as task_spec
from ocplanner.errors import DatasetError, InvalidValueError
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import require_choice

FIRST_EVALUATION_SEED = 10000
_SEEDS_EACH = 1000
_VALID_SHARE = 0.1
_MOST_NOISE = 5.0
_OF_EACH_ARM = ("eef_pos", "eef_quat", "eef_quat_site", "gripper_qpos")


@dataclass(frozen=True)
class Collected:
    """What was collected.

    Attributes:
        path: the data set.
        demonstrations: how many it holds.
        failures: attempts that failed (with a flaw: succeeded) and were left out.
    """

    path: Path
    demonstrations: int
    failures: int


@dataclass(frozen=True)
class Workplace:
    """What one worker needs."""

    task: str
    robot: str

    def make(self) -> ManipulationEnv:
        """Put the robot before the task."""
        return make_env(self.task, self.robot, cameras=())


def collect(
    path: str | Path,
    task: str = "Square",
    robot: str = "Panda",
    *,
    episodes: int = 100,
    seed: int = 0,
    flaw: Flaw | None = None,
    noise: float = 1.0,
    workers: int = 1,
    ray: str | None = None,
    overwrite: bool = False,
    progress: Callable[[str, bool], None] | None = None,
) -> Collected:
    """Let the scripted expert solve a task until enough attempts have succeeded, or failed because of a flaw.

    ``demo_K`` is the attempt with seed ``1000 * seed + K``; an attempt of the other outcome leaves a gap. The data set
    does not depend on the number of workers, and one that was stopped goes on when called again.

    Args:
        path: the data set to make, in the layout of robosuite 1.5.
        task: name of the task.
        robot: name of the robot.
        episodes: successes to record, with a flaw failures.
        seed: 0 to 9: which thousand of attempts; seeds from 10000 on are kept for evaluation.
        flaw: what the expert does wrong, see :func:`ocplanner.collection.flawed.fail`.
        noise: how far the demonstrations differ in path and tremor: 1 about as people's, 0 not at all.
        workers: processes.
        ray: address of a Ray cluster for the workers; see :func:`ocplanner.rollouts.episodes.run_episodes`.
        overwrite: replace ``path`` if it is there.
        progress: called with each attempt's name and whether it was recorded.

    Raises:
        UnknownNameError: no such task, robot or flaw, or no expert for the task.
        InvalidValueError: a number out of its domain.
        DatasetError: too many attempts failed.
        OutputError: ``path`` exists or cannot be written.
        ClusterError: there is no Ray cluster at the address.
    """
    spec, arm = task_spec(task), robot_spec(robot)
    expert_of(spec.name)
    if not 0 <= seed < FIRST_EVALUATION_SEED // _SEEDS_EACH:
        raise InvalidValueError(f"seed is {seed}, but must be 0 to {FIRST_EVALUATION_SEED // _SEEDS_EACH - 1}")
    if not 1 <= episodes <= _SEEDS_EACH or workers < 1:
        raise InvalidValueError(
            f"episodes must be 1 to {_SEEDS_EACH} and workers at least 1, not {episodes} and {workers}"
        )
    if flaw is not None:
        require_choice("flaw", flaw, Flaw)
    if not 0.0 <= noise <= _MOST_NOISE:
        raise InvalidValueError(f"noise is {noise}, but must be 0 to {_MOST_NOISE:g}")
    first = seed * _SEEDS_EACH
    workplace = Workplace(spec.name, arm.name)
    made = {"expert": "scripted", "first_seed": first, "noise": noise, **({} if flaw is None else {"flaw": flaw})}
    attrs = {"ocplanner_collect": json.dumps(made, sort_keys=True)}
    attempt_with = partial(record, flaw=flaw, noise=noise)
    with DatasetWriter(path, _env_args(workplace, arm.patches), data_attrs=attrs, overwrite=overwrite) as writer:
        succeeded = {int(name.removeprefix("demo_")) for name in writer.done}
        for attempt in sorted(succeeded):
            if progress:
                progress(f"demo_{attempt}", True)
        failures: set[int] = set()
        while len(succeeded) < episodes or not _settled(succeeded, failures, episodes):
            left = _next_attempts(succeeded, failures, episodes)
            if not left:
                raise DatasetError(
                    f"only {len(succeeded)} of {_SEEDS_EACH} attempts succeeded with {arm.name}; "
                    "the expert is made for Panda"
                )
            for number, arrays in run_episodes(
                workplace.make, attempt_with, [first + k for k in left], WorkerSettings(workers, ray)
            ):
                attempt = number - first
                if arrays is None:
                    failures.add(attempt)
                else:
                    writer.add(f"demo_{attempt}", arrays, {"seed": number})
                    succeeded.add(attempt)
                if progress:
                    progress(f"demo_{attempt}", arrays is not None)
        kept = sorted(succeeded)[:episodes]
        names = [f"demo_{attempt}" for attempt in kept]
        writer.finish(_masks(names, seed), names)
        return Collected(Path(path), len(names), sum(attempt < kept[-1] for attempt in failures))


def record(
    env: ManipulationEnv, seed: int, flaw: Flaw | None = None, noise: float = 1.0
) -> dict[str, np.ndarray] | None:
    """One attempt: robomimic's arrays, each row before its action; None if the expert fails, with a flaw if not."""
    rows: dict[str, list[np.ndarray]] = defaultdict(list)
    successes: list[bool] = []

    def note(action: np.ndarray) -> None:
        if rows["actions"]:
            successes.append(env.success())
        rows["states"].append(np.array(env.sim.get_state().flatten()))
        rows["actions"].append(action.copy())

    solved = demonstrate(env, seed, note, noise=noise) if flaw is None else fail(env, seed, flaw, note, noise=noise)
    if solved != (flaw is None):
        return None
    successes.append(env.success())
    for state in rows["states"]:
        for name, value in _observe(env, state).items():
            rows[f"obs/{name}"].append(value)
    arrays = {key: np.stack(values) for key, values in rows.items()}
    rewards = np.array(successes, dtype=np.float64)
    return {**arrays, "rewards": rewards, "dones": (rewards > 0).astype(np.int64)}


def _observe(env: ManipulationEnv, state: np.ndarray) -> dict[str, np.ndarray]:
    """The sensors' readings of a state, as robomimic extracts them.

    While the simulation runs, body poses lag behind the state by a physics step. The sensors are read twice, since
    robosuite 1.5 computes relative poses from the absolute ones of the reading before.
    """
    env.set_state(state)
    env.robosuite_env._get_observations(force_update=True)
    seen = env.robosuite_env._get_observations(force_update=True)
    sensors = {"object": "object-state"}
    for arm in range(len(env.arms)):
        sensors.update({f"robot{arm}_{name}": f"robot{arm}_{name}" for name in _OF_EACH_ARM})
    observed = {name: np.array(seen[sensor], dtype=np.float64) for name, sensor in sensors.items()}
    for spec in env.task.objects:  # by name too: readable whatever the order of numbers in `object`
        pose = env.object_pose(spec.name)
        observed[f"{spec.name}_pos"] = pose.position
        observed[f"{spec.name}_quat"] = Rotation.from_matrix(pose.rotation).as_quat()
    return observed


def _next_attempts(succeeded: set[int], failures: set[int], episodes: int) -> list[int]:
    """The lowest attempts not yet made that could complete the set."""
    done = succeeded | failures
    missing = max(0, episodes - len(succeeded))
    fresh = [attempt for attempt in range(_SEEDS_EACH) if attempt not in done]
    last = sorted(succeeded)[episodes - 1] if len(succeeded) >= episodes else _SEEDS_EACH
    return [attempt for attempt in fresh if attempt < last][: missing or None]


def _settled(succeeded: set[int], failures: set[int], episodes: int) -> bool:
    """Whether every attempt before the last one that is kept has been made."""
    return not _next_attempts(succeeded, failures, episodes)


def _masks(names: list[str], seed: int) -> dict[str, list[str]]:
    """A tenth for validation, drawn by the seed; nothing for it when there are fewer than two demonstrations."""
    count = min(len(names) - 1, max(1, round(_VALID_SHARE * len(names))))
    valid = {names[k] for k in np.random.default_rng(seed).permutation(len(names))[:count]}
    masks = {"train": [name for name in names if name not in valid], "valid": [name for name in names if name in valid]}
    return {mask: listed for mask, listed in masks.items() if listed}


def _env_args(workplace: Workplace, patches: tuple[str, ...]) -> dict[str, Any]:
    """robomimic's description of the environment."""
    with_controller = workplace.make()
    try:
        controllers = with_controller.robosuite_env.robots[0].composite_controller_config
    finally:
        with_controller.close()
    return {
        "env_name": task_spec(workplace.task).env_name,
        "type": 1,
        "env_version": version("robosuite"),
        "env_kwargs": {
            "robots": [workplace.robot] * task_spec(workplace.task).arms,
            "controller_configs": json.loads(json.dumps(controllers, default=str)),
            "control_freq": 20,
            "has_renderer": False,
            "has_offscreen_renderer": False,
            "ignore_done": True,
            "use_object_obs": True,
            "use_camera_obs": False,
            "reward_shaping": False,
            "lite_physics": True,
        },
        "ocplanner_patches": list(patches),
    }
