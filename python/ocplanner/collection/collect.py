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

from ocplanner.collection.attempts import attempt
from ocplanner.collection.experts import expert_of
from ocplanner.collection.settings import SEEDS_EACH, CollectSettings, Flaw
from ocplanner.demos.writer import DatasetWriter
from ocplanner.envs.environment import ManipulationEnv, make_env
from ocplanner.errors import DatasetError
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from ocplanner.settings import to_dict
from ocplanner.versions import installed

_VALID_SHARE = 0.1
_OF_EACH_ARM = ("eef_pos", "eef_quat", "eef_quat_site", "gripper_qpos")
_SQUARE = CollectSettings()
_ONE_WORKER = WorkerSettings()


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


def collect(
    path: str | Path,
    settings: CollectSettings = _SQUARE,
    workers: WorkerSettings = _ONE_WORKER,
    *,
    overwrite: bool = False,
    progress: Callable[[str, bool], None] | None = None,
) -> Collected:
    """Let the scripted expert try a task until enough attempts have succeeded, or failed because of a flaw.

    ``demo_K`` is the attempt with seed ``1000 * seed + K``; an attempt of the other outcome leaves a gap. The data set
    does not depend on the workers. If the function is stopped, the next call with the same settings continues.

    Args:
        path: the data set to make, in the layout of robosuite 1.5.
        settings: which demonstrations.
        workers: how many worker processes, and where.
        overwrite: replace ``path`` if it exists.
        progress: called with each attempt's name and whether it was recorded.

    Raises:
        UnknownNameError: the task has no expert.
        DatasetError: too many attempts failed.
        OutputError: ``path`` exists or cannot be written.
        ClusterError: there is no Ray cluster at the address.
    """
    expert_of(settings.task)
    make = partial(make_env, settings.task, settings.robot, cameras=())
    attempt_with = partial(record, flaw=settings.flaw, noise=settings.noise)
    first, episodes = settings.first_seed, settings.episodes
    with DatasetWriter(path, _env_args(make), data_attrs=_attributes(settings), overwrite=overwrite) as writer:
        succeeded = {int(name.removeprefix("demo_")) for name in writer.done}
        for number in sorted(succeeded):
            if progress:
                progress(f"demo_{number}", True)
        failures: set[int] = set()
        while left := _next_attempts(succeeded, failures, episodes):
            for seed, arrays in run_episodes(make, attempt_with, [first + number for number in left], workers):
                number = seed - first
                if arrays is None:
                    failures.add(number)
                else:
                    writer.add(f"demo_{number}", arrays, {"seed": seed})
                    succeeded.add(number)
                if progress:
                    progress(f"demo_{number}", arrays is not None)
        if len(succeeded) < episodes:
            raise DatasetError(
                f"only {len(succeeded)} of {SEEDS_EACH} attempts succeeded with {settings.robot}; the expert is made "
                "for the Panda: record with that arm, or ask for fewer episodes"
            )
        kept = sorted(succeeded)[:episodes]
        names = [f"demo_{number}" for number in kept]
        writer.finish(_masks(names, settings.seed), names)
        return Collected(Path(path), len(names), sum(number < kept[-1] for number in failures))


def record(
    env: ManipulationEnv, seed: int, flaw: Flaw | None = None, noise: float = 1.0
) -> dict[str, np.ndarray] | None:
    """One attempt as robomimic's arrays, each row before its action; None if it fails, with a flaw if it succeeds."""
    rows: dict[str, list[np.ndarray]] = defaultdict(list)
    successes: list[bool] = []

    def note(action: np.ndarray) -> None:
        if rows["actions"]:
            successes.append(env.success())
        rows["states"].append(np.array(env.sim.get_state().flatten()))
        rows["actions"].append(action.copy())

    if attempt(env, seed, note, flaw=flaw, noise=noise) != (flaw is None):
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

    While the simulation runs, body poses lag behind the state by a physics step, so the state is set anew. The sensors
    are read twice because robosuite 1.5 computes relative poses from the absolute ones of the previous reading.
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
    """The lowest attempts not yet made that can complete the set; none when all before the last kept one are made."""
    missing = max(0, episodes - len(succeeded))
    last = SEEDS_EACH if missing else sorted(succeeded)[episodes - 1]
    return [number for number in range(last) if number not in succeeded | failures][: missing or None]


def _masks(names: list[str], seed: int) -> dict[str, list[str]]:
    """Masks ``train`` and ``valid``: a tenth, drawn with the seed, is for validation; none if there is only one."""
    count = min(len(names) - 1, max(1, round(_VALID_SHARE * len(names))))
    valid = {names[k] for k in np.random.default_rng(seed).permutation(len(names))[:count]}
    masks = {"train": [name for name in names if name not in valid], "valid": [name for name in names if name in valid]}
    return {mask: listed for mask, listed in masks.items() if listed}


def _attributes(settings: CollectSettings) -> dict[str, str]:
    """Attributes of ``data`` that say how it was collected.

    The number of episodes is left out: a collection that was stopped may continue with more or fewer.
    """
    made = {name: value for name, value in to_dict(settings).items() if name != "episodes"}
    made |= {"expert": "scripted", "first_seed": settings.first_seed, "versions": installed()}
    return {"ocplanner_collect": json.dumps(made, sort_keys=True)}


def _env_args(make: Callable[[], ManipulationEnv]) -> dict[str, Any]:
    """robomimic's description of the environment."""
    with make() as env:
        controllers = env.robosuite_env.robots[0].composite_controller_config
        return {
            "env_name": env.task.env_name,
            "type": 1,
            "env_version": version("robosuite"),
            "env_kwargs": {
                "robots": [env.robot.name] * env.task.arms,
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
            "ocplanner_patches": list(env.patches),
        }
