"""Odd inputs: files as people hold them, each made from a few scripted demonstrations of Lift. No foreign file is used.

Each maker changes one thing. :data:`INPUTS` has them by name, with what they are, for ``table.py`` and the tests.
"""

import contextlib
import functools
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ocplanner.cli import main

SIZE = 24
"""Pixels of the base's pictures."""
_HELD_M = 0.15
_OSC = {"type": "OSC_POSE", "input_max": 1, "input_min": -1, "output_max": [0.05] * 3 + [0.5] * 3}


class Base:
    """What odd inputs are made from, made when first asked for and kept in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    @functools.cached_property
    def lift(self) -> Path:
        """Three scripted demonstrations of Lift on a Panda with states, observations and small pictures.

        Masks ``train`` (demo_0, demo_1) and ``valid`` (demo_2).
        """
        bare, path = self.folder / "bare.hdf5", self.folder / "lift.hdf5"
        _run("collect", "--out", str(bare), "--task", "Lift", "--episodes", "3")
        _run("render", str(bare), str(path), "--size", str(SIZE), "--observe", "full", "--workers", "1")
        with h5py.File(path, "r+") as file:
            del file["mask"]
            file["mask/train"], file["mask/valid"] = [b"demo_0", b"demo_1"], [b"demo_2"]
        return path

    @functools.cached_property
    def model(self) -> str:
        """The MuJoCo model of the scene, as recordings store it."""
        from ocplanner.envs import make_env

        with make_env("Lift", "Panda", cameras=()) as env:
            return env.robosuite_env.model.get_xml()


def _run(*arguments: str) -> None:
    if main(list(arguments)):
        raise RuntimeError(f"ocplanner {' '.join(arguments)} failed")


Maker = Callable[[Base, Path], object]
"""Writes an odd input to a path. May return a context manager: the input is odd while that is open."""


@dataclass(frozen=True)
class Input:
    """An odd input.

    Attributes:
        name: of its maker.
        what: what is odd, in words.
        make: the maker.
        reading: flags with which verbs that read data sets are called.
        policy: further flags of train-policy.
        convert: further flags of convert.
    """

    name: str
    what: str
    make: Maker
    reading: tuple[str, ...] = ()
    policy: tuple[str, ...] = ()
    convert: tuple[str, ...] = ()

    @contextlib.contextmanager
    def at(self, base: Base, folder: Path) -> Iterator[Path]:
        """Make it in an empty folder; it is odd inside the block."""
        path = folder / "input.hdf5"
        held = self.make(base, path)
        with held if isinstance(held, contextlib.AbstractContextManager) else contextlib.nullcontext():
            yield path


INPUTS: dict[str, Input] = {}


def _odd(what: str, **flags: tuple[str, ...]) -> Callable[[Maker], Maker]:
    def register(make: Maker) -> Maker:
        name = getattr(make, "__name__", "").replace("_", "-")
        INPUTS[name] = Input(name, what, make, **flags)
        return make

    return register


def _skipping(name: str) -> None:
    """The same input, read with --skip-bad."""
    odd = INPUTS[name]
    INPUTS[f"{name}-skipped"] = replace(
        odd, name=f"{name}-skipped", what=f"{odd.what}; --skip-bad", reading=("--skip-bad",)
    )


def _mending(name: str, flag: str) -> None:
    """The same input, read from what convert makes of it."""
    odd = INPUTS[name]
    INPUTS[f"{name}-mended"] = replace(odd, name=f"{name}-mended", what=f"{odd.what}; convert {flag}", convert=(flag,))


@contextlib.contextmanager
def copy_of(base: Base, path: Path) -> Iterator[h5py.File]:
    """A copy of the base, open for changes."""
    shutil.copyfile(base.lift, path)
    with h5py.File(path, "r+") as file:
        yield file


def change_env_args(file: h5py.File, **kwargs: Any) -> None:
    """Change some of ``env_kwargs``."""
    env_args = json.loads(file["data"].attrs["env_args"])
    env_args["env_kwargs"] |= kwargs
    file["data"].attrs["env_args"] = json.dumps(env_args)


def replace_array(file: h5py.File, path: str, array: np.ndarray) -> None:
    """Put another array in place of one."""
    del file[path]
    file[path] = array


def keep_rows(file: h5py.File, rows_of: Callable[[int], np.ndarray]) -> None:
    """Keep the rows that ``rows_of(steps)`` names, in all arrays; a row that repeats the one before moves no joint."""
    for demo in file["data"].values():
        rows = rows_of(demo["actions"].shape[0])
        paths: list[str] = []
        demo.visititems(lambda path, item, paths=paths: paths.append(path) if isinstance(item, h5py.Dataset) else None)
        for path in paths:
            replace_array(demo, path, demo[path][:][rows])
        still = np.append(np.diff(rows) == 0, False)
        demo["actions"][:, :6] = np.where(still[:, None], 0.0, demo["actions"][:, :6])
        demo.attrs["num_samples"] = len(rows)


# Motion


@_odd("nothing is odd")
def plain(base: Base, path: Path) -> None:
    shutil.copyfile(base.lift, path)


@_odd("keyboard teleoperation: after every second step the hand pauses for two")
def stop_and_go(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        keep_rows(file, lambda steps: np.repeat(np.arange(steps), np.where(np.arange(steps) % 2, 3, 1)))


@_odd("five times slower")
def slow(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        keep_rows(file, lambda steps: np.repeat(np.arange(steps), 5))


@_odd("every fourth step of 20 a second, and env_args says so", policy=("--low-dim", "robot0_eef_pos"))
def five_hertz(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        keep_rows(file, lambda steps: np.arange(0, steps, 4))
        change_env_args(file, control_freq=5)


@_odd("the object stays where it lies in demo_1")
def never_lifted(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        demo = file["data/demo_1"]
        for key in ("obs/cube_pos", "obs/cube_quat"):
            demo[key][:] = demo[key][0]
        demo["states"][:, 10:17] = demo["states"][0, 10:17]
        parts = (demo["obs/cube_pos"][:], demo["obs/cube_quat"][:])
        demo["obs/object"][:] = np.concatenate((*parts, demo["obs/robot0_eef_pos"][:] - parts[0]), axis=1)


# The recorded world


@_odd("recorded with another gripper than the arm's own (gripper_types)")
def other_gripper(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        change_env_args(file, gripper_types="Robotiq85Gripper")


@_odd("a Panda's states, but env_args says Sawyer")
def other_arm(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        change_env_args(file, robots=["Sawyer"])


@_odd("an arm that robosuite does not have")
def unknown_arm(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        change_env_args(file, robots=["Atlas"])


@_odd("a task that ocplanner does not know")
def unknown_task(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        env_args = json.loads(file["data"].attrs["env_args"])
        file["data"].attrs["env_args"] = json.dumps(env_args | {"env_name": "Coffee_D0"})


def _with_model(base: Base, path: Path, change: Callable[[str], str]) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            demo.attrs["model_file"] = change(base.model)


def _cube(model: str, attribute: str, value: str) -> str:
    """The model with another attribute of both geoms of the cube."""
    import re

    def changed(geom: re.Match[str]) -> str:
        return re.sub(rf'\b{attribute}="[^"]*"', f'{attribute}="{value}"', geom.group())

    return re.sub(r'<geom[^>]*name="cube_g0[^>]*>', changed, model)


@_odd("model_file as robosuite stores it")
def own_model(base: Base, path: Path) -> None:
    _with_model(base, path, lambda model: model)


@_odd("model_file has a cube with sides of 6 cm")
def other_size(base: Base, path: Path) -> None:
    _with_model(base, path, lambda model: _cube(model, "size", "0.03 0.03 0.03"))


@_odd("model_file has a ball in place of the cube")
def other_object(base: Base, path: Path) -> None:
    _with_model(base, path, lambda model: _cube(model, "type", "sphere"))


@_odd("model_file has its table 20 cm lower")
def other_table(base: Base, path: Path) -> None:
    import re

    def lower(model: str) -> str:
        return re.sub(r'(<body[^>]*name="table"[^>]*pos=")[^"]*"', r'\g<1>0 0 0.6"', model)

    _with_model(base, path, lower)


@_odd("model_file is cut off")
def damaged_model(base: Base, path: Path) -> None:
    _with_model(base, path, lambda model: model[: len(model) // 2])


@_odd("model_file declares a document type with an entity")
def hostile_model(base: Base, path: Path) -> None:
    _with_model(base, path, lambda model: '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>' + model)


@_odd("states with one number too few")
def narrow_states(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            replace_array(demo, "states", demo["states"][:, :-1])


@_odd("recorded under joint velocities")
def joint_controller(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        change_env_args(file, controller_configs={"type": "JOINT_VELOCITY", "input_max": 1, "input_min": -1})


# Pictures


@_odd("pictures stored upside down, drawn by something else")
def upside_down(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        del file["data"].attrs["ocplanner_render"]
        for demo in file["data"].values():
            replace_array(demo, "obs/agentview_image", demo["obs/agentview_image"][:][:, ::-1])


_mending("upside-down", "--flip-images")


@_odd("pictures that something else drew; nothing says how")
def pictures_of_unknown_origin(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        del file["data"].attrs["ocplanner_render"]


@_odd("pictures that are black")
def black(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            demo["obs/agentview_image"][:] = 0


@_odd("pictures as numbers from 0 to 1, channels first")
def float_pictures(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            images = np.moveaxis(demo["obs/agentview_image"][:], -1, 1).astype(np.float32) / 255
            replace_array(demo, "obs/agentview_image", images)


# Actions


@_odd("absolute actions, but env_args says they are differences")
def unflagged_absolute(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            demo["actions"][:, :3] = demo["obs/robot0_eef_pos"][:]
            demo["actions"][:, 3:6] = [3.1, 0.1, 0.0]


@_odd("absolute actions, and env_args says so")
def flagged_absolute(base: Base, path: Path) -> None:
    unflagged_absolute(base, path)
    with h5py.File(path, "r+") as file:
        change_env_args(file, controller_configs={**_OSC, "control_delta": False})


@_odd("1 opens the gripper and -1 closes it")
def flipped_gripper(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            demo["actions"][:, 6] *= -1


_mending("flipped-gripper", "--flip-gripper")


@_odd("six numbers an action: the gripper's is missing")
def no_gripper_action(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            replace_array(demo, "actions", demo["actions"][:, :6])


# Masks


def _masks(base: Base, path: Path, **masks: list[str]) -> None:
    with copy_of(base, path) as file:
        del file["mask"]
        for name, listed in masks.items():
            file.create_dataset(f"mask/{name}", data=np.array([entry.encode() for entry in listed], dtype="S8"))


@_odd("mask/train names demo_0 twice")
def duplicate_in_mask(base: Base, path: Path) -> None:
    _masks(base, path, train=["demo_0", "demo_0", "demo_1"], valid=["demo_2"])


@_odd("mask/train names demo_7, which is not there")
def absent_in_mask(base: Base, path: Path) -> None:
    _masks(base, path, train=["demo_0", "demo_1", "demo_7"], valid=["demo_2"])


_skipping("absent-in-mask")


@_odd("demo_1 is in mask/train and in mask/valid")
def overlapping_masks(base: Base, path: Path) -> None:
    _masks(base, path, train=["demo_0", "demo_1"], valid=["demo_1", "demo_2"])


@_odd("mask/valid is mask/train")
def equal_masks(base: Base, path: Path) -> None:
    _masks(base, path, train=["demo_0", "demo_1"], valid=["demo_0", "demo_1"])


@_odd("mask/train is empty")
def empty_mask(base: Base, path: Path) -> None:
    _masks(base, path, train=[], valid=["demo_2"])


_ALL = ("--mask", "all")


@_odd("no masks", policy=_ALL)
def no_masks(base: Base, path: Path) -> None:
    _masks(base, path)


# Layouts


def strip_to_raw(base: Base, path: Path, version: str, controllers: dict[str, Any], *, late: bool, loud: float) -> None:
    """What robosuite's own recorder writes.

    Args:
        base: the source.
        path: the file to make.
        version: of robosuite.
        controllers: ``controller_configs``.
        late: the states are those after the actions, as robosuite 1.0 recorded them.
        loud: factor of the actions.
    """
    with h5py.File(base.lift) as source, h5py.File(path, "w") as file:
        info = {"env_name": "Lift", "robots": "Panda", "controller_configs": controllers}
        data = file.create_group("data")
        data.attrs.update({"env": "Lift", "env_info": json.dumps(info), "repository_version": version})
        for number, demo in enumerate(source["data"].values(), 1):
            states, actions = demo["states"][:], demo["actions"][:] * loud
            if late:
                states, actions = states[1:], actions[:-1]
            group = data.create_group(f"demo_{number}")
            group["states"], group["actions"] = states, actions
            group.attrs["model_file"] = f"model_{number}.xml" if late else base.model


@_odd("robosuite's own recording, version 1.0: states after the actions, model_file names a file", policy=_ALL)
def raw_1_0(base: Base, path: Path) -> None:
    strip_to_raw(base, path, "1.0.0", _OSC, late=True, loud=1.0)


@_odd("robosuite's own recording, version 1.4", policy=_ALL)
def raw_1_4(base: Base, path: Path) -> None:
    strip_to_raw(base, path, "1.4.0", _OSC, late=False, loud=1.0)


@_odd("robosuite's own recording, version 1.5", policy=_ALL)
def raw_1_5(base: Base, path: Path) -> None:
    strip_to_raw(base, path, "1.5.1", {"type": "BASIC", "body_parts": {"right": _OSC}}, late=False, loud=1.0)


@_odd("robosuite's own recording with actions up to 3.75, which its controller clipped", policy=_ALL)
def raw_loud(base: Base, path: Path) -> None:
    strip_to_raw(base, path, "1.4.0", _OSC, late=False, loud=3.75)


@_odd("robosuite's own recording of a Panda, but env_info says Sawyer", policy=_ALL)
def raw_other_arm(base: Base, path: Path) -> None:
    raw_1_4(base, path)
    with h5py.File(path, "r+") as file:
        info = json.loads(file["data"].attrs["env_info"])
        file["data"].attrs["env_info"] = json.dumps(info | {"robots": "Sawyer"})


@_odd("robomimic's, with states and actions alone")
def states_only(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            for key in [key for key in demo if key not in ("states", "actions")]:
                del demo[key]


_FOREIGN = ("--low-dim", "robot0_eef_pos", "robot0_gripper_qpos")


def _foreign(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for name in list(file["data"].attrs):
            del file["data"].attrs[name]


@_odd("a real robot's: no env_args, no states", policy=_FOREIGN)
def no_states(base: Base, path: Path) -> None:
    _foreign(base, path)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            del demo["states"]


@_odd("a real robot's: no env_args, states is a group", policy=_FOREIGN)
def states_group(base: Base, path: Path) -> None:
    _foreign(base, path)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            joints = demo["states"][:, 1:8]
            del demo["states"]
            demo["states/joint_positions"] = joints


@_odd("a real robot's: no env_args, states of another width in each demonstration", policy=_FOREIGN)
def mixed_states(base: Base, path: Path) -> None:
    _foreign(base, path)
    with h5py.File(path, "r+") as file:
        for number, demo in enumerate(file["data"].values()):
            replace_array(demo, "states", demo["states"][:, : 8 + number])


@_odd("a real robot's: absolute actions of 8 numbers (position, quaternion, gripper)", policy=_FOREIGN)
def eight_numbers(base: Base, path: Path) -> None:
    no_states(base, path)
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            parts = (demo["obs/robot0_eef_pos"][:], demo["obs/robot0_eef_quat"][:], demo["actions"][:, 6:])
            replace_array(demo, "actions", np.concatenate(parts, axis=1))


@_odd(
    "a real robot's: the hand's place is called ee_pos, and --keys says so",
    reading=("--keys", "keys.json"),
    policy=("--low-dim", "robot0_eef_pos"),
)
def other_names(base: Base, path: Path) -> None:
    no_states(base, path)
    path.with_name("keys.json").write_text('{"robot0_eef_pos": "ee_pos"}', encoding="utf-8")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            demo["obs"].move("robot0_eef_pos", "ee_pos")


# One bad demonstration


@_odd("actions of demo_1 hold a NaN")
def nan_action(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        file["data/demo_1/actions"][4, 2] = np.nan


@_odd("observations of demo_1 hold a NaN")
def nan_observation(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        file["data/demo_1/obs/robot0_eef_pos"][4, 2] = np.nan


@_odd("states of demo_1 hold an infinity")
def infinite_state(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        file["data/demo_1/states"][4, 2] = np.inf


def _only(base: Base, path: Path, steps: int) -> None:
    with copy_of(base, path) as file:
        demo = file["data/demo_1"]
        paths: list[str] = []
        demo.visititems(lambda path, item: paths.append(path) if isinstance(item, h5py.Dataset) else None)
        for name in paths:
            replace_array(demo, name, demo[name][:steps])


@_odd("demo_1 has no step")
def no_step(base: Base, path: Path) -> None:
    _only(base, path, 0)


@_odd("demo_1 has one step")
def one_step(base: Base, path: Path) -> None:
    _only(base, path, 1)


@_odd("demo_1 is an empty group")
def empty_group(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        del file["data/demo_1"]
        file.create_group("data/demo_1")


@_odd("demo_1 has fewer observations than actions")
def short_observations(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        replace_array(file, "data/demo_1/obs/robot0_eef_pos", file["data/demo_1/obs/robot0_eef_pos"][:-3])


for _name in ("never-lifted", "nan-action", "nan-observation", "infinite-state", "no-step", "one-step", "empty-group"):
    _skipping(_name)


@_odd("all three demonstrations hold a NaN", reading=("--skip-bad",))
def all_bad(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for demo in file["data"].values():
            demo["actions"][0, 0] = np.nan


# Files


@_odd("no file")
def no_file(base: Base, path: Path) -> None:
    """Nothing is made."""


@_odd("an empty file")
def empty_file(base: Base, path: Path) -> None:
    path.write_bytes(b"")


@_odd("a text")
def text_file(base: Base, path: Path) -> None:
    path.write_text("version https://git-lfs.github.com/spec/v1\n", encoding="utf-8")


@_odd("the first half of a file")
def truncated(base: Base, path: Path) -> None:
    content = base.lift.read_bytes()
    path.write_bytes(content[: len(content) // 2])


@_odd("an HDF5 file without data")
def no_data(base: Base, path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["images"] = np.zeros((4, 8, 8, 3), dtype=np.uint8)


@_odd("an HDF5 file with no demonstration in data")
def no_demonstrations(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        for name in list(file["data"]):
            del file["data"][name]


@_odd("env_args is no JSON")
def damaged_env_args(base: Base, path: Path) -> None:
    with copy_of(base, path) as file:
        file["data"].attrs["env_args"] = "Lift"


@_odd("another process writes the file")
def locked(base: Base, path: Path) -> contextlib.AbstractContextManager[object]:
    import fcntl

    shutil.copyfile(base.lift, path)
    handle = path.open("r+b")
    fcntl.flock(handle, fcntl.LOCK_EX)  # as HDF5 locks what it writes
    return contextlib.closing(handle)


@_odd("the folder of a LeRobot data set")
def lerobot_folder(base: Base, path: Path) -> None:
    (path / "meta").mkdir(parents=True)
    info = {"codebase_version": "v3.0", "fps": 20, "features": {}, "total_episodes": 3, "total_frames": 200}
    (path / "meta/info.json").write_text(json.dumps(info), encoding="utf-8")
