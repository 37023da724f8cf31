"""Data that the tests of several rooms share: the real Square recordings where present, and a synthetic stand-in."""

import functools
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import settings

from ocplanner.envs import ManipulationEnv, make_env
from ocplanner.geometry.pose import Pose

# A busy machine must not fail a test; pytest's own timeout ends what hangs.
settings.register_profile("ocplanner", deadline=None)
settings.load_profile("ocplanner")

Joints = Callable[[np.ndarray], np.ndarray]
GRASP_STEP, LIFT_STEP, RELEASE_STEP, STEPS = 24, 30, 78, 90


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder with real recordings: $OCPLANNER_DATA, else ../shared/data beside the repository."""
    return Path(os.environ.get("OCPLANNER_DATA") or Path(__file__).parents[2] / "shared" / "data")


@pytest.fixture(scope="session")
def square_ph(data_folder: Path) -> Path:
    """robomimic's Square PH data set (200 human demonstrations, states only)."""
    path = data_folder / "square_ph.hdf5"
    if not path.is_file():
        pytest.skip(
            f"robomimic's Square PH is not at {path}; the README says how to get it, OCPLANNER_DATA where it is"
        )
    return path


@pytest.fixture(scope="session")
def tiny_square(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """``tiny_square(env_version="1.4.1", images=False) -> Path``: 4 synthetic Square demonstrations.

    A Panda that grasps the nut, carries and turns it, lowers it onto the peg and opens: shapes, frames, order of
    ``object`` and attributes are those of the version; ``1.5.1`` adds ``model_file`` and ``next_obs``. Masks ``train``
    (demo_0, demo_1, demo_10) and ``valid`` (demo_2).
    """
    folder = tmp_path_factory.mktemp("tiny_square")

    @functools.cache
    def make(env_version: str = "1.4.1", images: bool = False) -> Path:
        path = folder / f"square_{env_version}{'_images' if images else ''}.hdf5"
        _write_tiny_square(path, env_version, images)
        return path

    return make


@pytest.fixture(scope="session")
def carried_objects(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """``carried_objects("ToolHang") -> Path``: two demonstrations of a task whose objects are carried one by one.

    ``ToolHang``: the frame in steps 10 to 40, the tool in steps 60 to 90. ``TwoArmTransport``: the lid, the rubbish and
    the hammer, which the first arm carries in steps 110 to 140, holds still, and lets go of at 150, when the second has
    closed its hand; that one carries it in steps 160 to 190. What is let go of falls.
    """
    folder = tmp_path_factory.mktemp("carried_objects")

    @functools.cache
    def make(env_name: str) -> Path:
        path = folder / f"{env_name}.hdf5"
        _write_carried_objects(path, env_name)
        return path

    return make


@pytest.fixture
def frames() -> np.ndarray:
    """Twelve frames of a dark square that moves right over a light ground, (12, 64, 96, 3) uint8."""
    images = np.full((12, 64, 96, 3), 230, dtype=np.uint8)
    for i, image in enumerate(images):
        image[28:36, 4 * i : 4 * i + 8] = 40
    return images


def _write_carried_objects(path: Path, env_name: str) -> None:
    if env_name == "ToolHang":
        carries = [("frame", 0, 10, 40, 40), ("tool", 0, 60, 90, 90)]  # object, arm, closing, last motion, opening
    else:
        carries = [("lid", 0, 10, 40, 40), ("trash", 1, 60, 90, 90), ("payload", 0, 110, 140, 150)]
        carries.append(("payload", 1, 145, 190, 190))
    arms, steps = 1 + max(arm for _, arm, *_ in carries), carries[-1][-1] + 15
    actions, positions = np.zeros((steps, 7 * arms)), {name: np.zeros((steps, 3)) for name, *_ in carries}
    actions[:, 6::7] = -1.0
    for name, arm, closing, last, opening in carries:
        actions[closing:opening, 7 * arm + 6] = 1.0
        positions[name][:, 0] += 0.01 * np.clip(np.arange(steps) - max(closing, last - 30), 0, 30)
        positions[name][closing + 5 : carries[-1][-1] if name == "payload" else opening, 2] = 0.1
    with h5py.File(path, "w") as file:
        kwargs = {"robots": ["Panda"] * arms, "controller_configs": {"type": "OSC_POSE"}}
        env_args = {"env_name": env_name, "env_version": "1.5.1", "type": 1, "env_kwargs": kwargs}
        file.create_group("data").attrs.update({"env_args": json.dumps(env_args), "total": 2 * steps})
        for demo in ("demo_0", "demo_1"):
            file[f"data/{demo}/actions"] = actions
            file[f"data/{demo}"].attrs["num_samples"] = steps
            for name, places in positions.items():
                file[f"data/{demo}/obs/{name}_pos"] = places
                file[f"data/{demo}/obs/{name}_quat"] = np.tile([0.0, 0.0, 0.0, 1.0], (steps, 1))


def _write_tiny_square(path: Path, env_version: str, images: bool) -> None:
    modern = env_version >= "1.5"
    osc = {"type": "OSC_POSE", "input_max": 1, "input_min": -1}
    controllers = {"type": "BASIC", "body_parts": {"right": osc}} if modern else osc
    env_args = {
        "env_name": "NutAssemblySquare",
        "env_version": env_version,
        "env_type" if modern else "type": 1,
        "env_kwargs": {"robots": ["Panda"], "control_freq": 20, "controller_configs": controllers},
    }
    with h5py.File(path, "w") as file, make_env("Square", "Panda", cameras=()) as env:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps(env_args, indent=4)
        data.attrs["total"] = 4 * STEPS
        for seed, name in enumerate(("demo_0", "demo_1", "demo_10", "demo_2")):
            rng = np.random.default_rng(seed)
            demo = data.create_group(name)
            demo.attrs["num_samples"] = STEPS
            arrays = _tiny_demonstration(rng, modern, partial(_reached, env))
            if images:
                arrays["obs/agentview_image"] = rng.integers(0, 256, (STEPS, 84, 84, 3), dtype=np.uint8)
            if modern:
                demo.attrs["model_file"] = '<mujoco model="base"></mujoco>'
                for key in [key for key in arrays if key.startswith("obs/")]:
                    arrays[f"next_{key}"] = np.concatenate([arrays[key][1:], arrays[key][-1:]])
            for key, array in arrays.items():
                demo.create_dataset(key, data=array)
        file["mask/train"] = np.array([b"demo_0", b"demo_1", b"demo_10"])
        file["mask/valid"] = np.array([b"demo_2"])


def _reached(env: ManipulationEnv, positions: np.ndarray) -> np.ndarray:
    """The arm's joints with its hand at each of the positions, or as near as it gets."""
    env.reset(0)
    rotation, rows = env.eef_pose().rotation, env.arms[0].joints.qpos
    found = []
    for position in positions:
        env.place_eef(Pose(position, rotation), restarts=0)
        assert np.linalg.norm(env.eef_pose().position - position) < 2e-2
        found.append(env.data.qpos[rows].copy())
    return np.array(found)


def _tiny_demonstration(rng: np.random.Generator, modern: bool, joints: Joints) -> dict[str, np.ndarray]:
    rest = np.array([rng.uniform(-0.115, -0.11), rng.uniform(0.11, 0.225), 0.83])
    above_peg = np.array([0.23, 0.10, 1.0])
    ease = _smooth(np.clip((np.arange(STEPS) - LIFT_STEP) / (RELEASE_STEP - 12 - LIFT_STEP), 0, 1))
    nut_pos = rest + ease[:, None] * (above_peg - rest)
    lower = _smooth(np.clip((np.arange(STEPS) - (RELEASE_STEP - 12)) / 10, 0, 1))
    nut_pos[:, 2] -= 0.08 * lower
    turn = ease * 0.8  # the hand turns with the nut, which it holds by the handle beside the nut's centre
    eef_pos = nut_pos + np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), np.full(STEPS, 0.01)], axis=1)
    eef_pos[:LIFT_STEP, 2] += np.linspace(0.15, 0, LIFT_STEP)
    nut_pos[RELEASE_STEP:, 2] = np.maximum(0.829, 0.92 - 0.03 * np.arange(STEPS - RELEASE_STEP))
    nut_pos[:6, 2] = [0.89, 0.877, 0.84, 0.822, 0.826, 0.828]
    yaw = rng.uniform(-1, 1) + turn
    nut_quat = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    eef_quat = np.stack([np.cos(yaw / 2), np.sin(yaw / 2), 0 * yaw, 0 * yaw], axis=1)  # pointing down

    seen_pos, seen_quat = nut_pos, nut_quat
    if modern:  # robosuite 1.5 computes the relative pose from the object's pose one step earlier
        seen_pos, seen_quat = (np.concatenate([a[:1], a[:-1]]) for a in (nut_pos, nut_quat))
    inverse = eef_quat * [-1, -1, -1, 1]
    relative_pos = _rotate(inverse, seen_pos - eef_pos)
    relative_quat = _multiply(inverse, seen_quat)
    if modern:
        relative_pos[0], relative_quat[0] = 0, 0
    poses = [nut_pos, nut_quat, relative_pos, relative_quat]
    gripper = np.where((np.arange(STEPS) >= GRASP_STEP) & (np.arange(STEPS) < RELEASE_STEP), 1.0, -1.0)
    actions = np.zeros((STEPS, 7))
    actions[:-1, :3] = np.clip(np.diff(eef_pos, axis=0) / 0.05, -1, 1)
    actions[:, 6] = gripper
    opening = np.where(gripper > 0, 0.01, 0.04)
    states = np.zeros((STEPS, 45))
    states[:, 0] = np.arange(STEPS) / 20
    states[:, 1:8] = joints(eef_pos)
    states[:, 8], states[:, 9] = opening, -opening
    states[:, 10:17] = np.concatenate([nut_pos, nut_quat[:, [3, 0, 1, 2]]], axis=1)
    states[:, 17:24] = [0, 0, 10, 1, 0, 0, 0]
    rewards = (np.arange(STEPS) >= STEPS - 3).astype(float)
    return {
        "actions": actions,
        "states": states,
        "rewards": rewards,
        "dones": rewards.astype(np.int64),
        "obs/object": np.concatenate(poses[2:] + poses[:2] if modern else poses, axis=1),
        "obs/robot0_eef_pos": eef_pos,
        "obs/robot0_eef_quat": eef_quat,
        "obs/robot0_gripper_qpos": np.stack([opening, -opening], axis=1),
    }


def _smooth(fraction: np.ndarray) -> np.ndarray:
    return fraction**2 * (3 - 2 * fraction)


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of (T, 4) quaternions, xyzw."""
    vector = a[:, 3:] * b[:, :3] + b[:, 3:] * a[:, :3] + np.cross(a[:, :3], b[:, :3])
    return np.concatenate([vector, a[:, 3:] * b[:, 3:] - np.sum(a[:, :3] * b[:, :3], axis=1, keepdims=True)], axis=1)


def _rotate(quat_xyzw: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    pure = np.concatenate([vectors, np.zeros((len(vectors), 1))], axis=1)
    return _multiply(_multiply(quat_xyzw, pure), quat_xyzw * [-1, -1, -1, 1])[:, :3]
