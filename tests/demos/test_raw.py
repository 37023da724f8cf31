"""Raw recordings of robosuite and files with states alone: what they lack comes from the simulator."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.collection.collect import collect
from ocplanner.collection.settings import CollectSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, MismatchError

OSC = {"type": "OSC_POSE", "input_max": 1, "input_min": -1, "output_max": [0.05] * 3 + [0.5] * 3}


def to_raw(source: Path, target: Path, *, late: bool = False, loud: float = 1.0) -> Path:
    """Strip a data set to what robosuite's own recorder writes.

    Args:
        source: a data set.
        target: the file to make.
        late: record the states after the actions, as robosuite up to 1.0.
        loud: factor of the actions.
    """
    with Demonstrations(source) as demos, h5py.File(target, "w") as file:
        data = file.create_group("data")
        info = {"env_name": demos.env_name, "robots": demos.robots[0], "controller_configs": OSC}
        version = "1.0.0" if late else "1.4.0"
        data.attrs.update({"env": demos.env_name, "env_info": json.dumps(info), "repository_version": version})
        for demo in demos:
            states, actions = demo.states, demo.actions * loud
            if late:
                states, actions = states[1:], actions[:-1]
            file[f"data/{demo.name}/states"], file[f"data/{demo.name}/actions"] = states, actions
            file[f"data/{demo.name}"].attrs["model_file"] = demo.model_file or "model.xml"
    return target


@pytest.fixture(scope="module")
def lift(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("lift") / "lift.hdf5"
    return collect(path, CollectSettings("Lift", episodes=2)).path


@pytest.mark.parametrize("late", [False, True])
def test_a_raw_recording_reads_like_the_data_set_it_was_stripped_from(lift, tmp_path, late):
    raw = to_raw(lift, tmp_path / "raw.hdf5", late=late)
    skipped = int(late)
    with Demonstrations(lift) as whole, Demonstrations(raw) as demos:
        assert (demos.kind, demos.env_name, demos.robots) == ("robosuite", "Lift", ("Panda",))
        for full, demo in zip(whole, demos):
            assert demo.length == full.length - 2 * skipped
            ends = slice(skipped, full.length - skipped)
            np.testing.assert_array_equal(demo.states, full.states[ends])
            np.testing.assert_array_equal(demo.actions, full.actions[ends])
            for array, stored in zip(demo.object_poses("cube"), full.object_poses("cube")):
                np.testing.assert_allclose(array, stored[ends], atol=1e-9)
            for key in ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos"):
                np.testing.assert_allclose(demo.observation(key), full.observation(key)[ends], atol=1e-9)
            assert demo.dones.tolist() == [0] * (demo.length - 1) + [1]
            if not late:
                assert demo.manipulation() == full.manipulation()
                np.testing.assert_array_equal(demo.rewards, full.rewards)


def test_actions_are_clipped_as_the_controller_clipped_them(lift, tmp_path):
    with Demonstrations(lift) as whole, Demonstrations(to_raw(lift, tmp_path / "raw.hdf5", loud=3.75)) as demos:
        np.testing.assert_array_equal(demos[0].actions, np.clip(3.75 * whole[0].actions, -1, 1))
        assert np.abs(demos[0].recorded_actions).max() > 1


def test_absolute_actions_are_not_clipped(tiny_square, tmp_path):
    path = tmp_path / "absolute.hdf5"
    path.write_bytes(tiny_square().read_bytes())
    with h5py.File(path, "r+") as file:
        env_args = json.loads(file["data"].attrs["env_args"])
        env_args["env_kwargs"]["controller_configs"]["control_delta"] = False
        file["data"].attrs["env_args"] = json.dumps(env_args)
        file["data/demo_0/actions"][:, 2] = 1.7
    with Demonstrations(path) as demos:
        assert demos[0].actions.max() == 1.7


def test_an_action_less_file_has_no_first_state_to_move(lift, tmp_path):
    raw = to_raw(lift, tmp_path / "raw.hdf5", late=True)
    with Demonstrations(raw) as demos:
        copy = demos[0].arrays()
        assert set(copy) == {"actions", "states"}
        assert len(copy["actions"]) == len(copy["states"]) == demos[0].length


def test_real_raw_recordings(data_folder):
    """People's own: by keyboard with pauses, and with states recorded after the step."""
    paths = sorted(data_folder.glob("*_raw.hdf5"))
    if not paths:
        pytest.skip(f"no raw robosuite recordings in {data_folder}; they are not part of the repository")
    kept = {}
    for path in paths:
        with Demonstrations(path) as demos:
            for demo in demos:
                positions, _ = demo.object_poses(demo.object_names[0])
                rows = list(demo.manipulation().rows)
                kept[demos.env_name, demo.name] = np.ptp(positions[rows, 2])
                assert demo.rewards[-1] == 1.0
    for name in ("demo_1", "demo_2", "demo_3"):
        assert kept["Lift", name] > 0.054
    assert kept["Stack", "demo_1"] > 0.1


def test_states_alone_give_the_recorded_poses(square_ph, tmp_path):
    path = tmp_path / "states.hdf5"
    with h5py.File(square_ph) as source, h5py.File(path, "w") as file:
        file.create_group("data").attrs["env_args"] = source["data"].attrs["env_args"]
        for key in ("states", "actions"):
            file[f"data/demo_0/{key}"] = source[f"data/demo_0/{key}"][:]
    with Demonstrations(square_ph) as whole, Demonstrations(path) as demos:
        full, demo = whole["demo_0"], demos[0]
        assert demo.manipulation() == full.manipulation()
        for array, stored in zip(demo.object_poses("SquareNut"), full.object_poses("SquareNut")):
            np.testing.assert_allclose(array, stored, atol=1e-6)
        np.testing.assert_allclose(demo.eef_positions, full.eef_positions, atol=1e-6)
        assert demo.object_layout() == full.object_layout()
        np.testing.assert_allclose(demo.observation("object"), full.observation("object"), atol=1e-4)


def _changed(path: Path, target: Path, **kwargs: object) -> Path:
    target.write_bytes(path.read_bytes())
    with h5py.File(target, "r+") as file:
        info = json.loads(file["data"].attrs["env_info"])
        file["data"].attrs["env_info"] = json.dumps({**info, **kwargs})
    return target


def test_one_missing_observation_is_derived_too(square_ph, tmp_path):
    path = tmp_path / "part.hdf5"
    with h5py.File(square_ph) as source, h5py.File(path, "w") as file:
        file.create_group("data").attrs["env_args"] = source["data"].attrs["env_args"]
        source.copy("data/demo_0", file["data"])
        del file["data/demo_0/obs/object"]
    with Demonstrations(square_ph) as whole, Demonstrations(path) as demos:
        full, demo = whole["demo_0"], demos[0]
        assert full.derived_keys == ()
        assert set(demo.derived_keys) == {"object", "SquareNut_pos", "SquareNut_quat"}
        np.testing.assert_allclose(demo.observation("object"), full.observation("object"), atol=1e-4)
        assert demo.manipulation() == full.manipulation()


def test_another_recorded_world_is_told(lift, tmp_path):
    raw = to_raw(lift, tmp_path / "raw.hdf5")
    with (
        Demonstrations(_changed(raw, tmp_path / "gripper.hdf5", gripper_types="Robotiq85Gripper")) as demos,
        pytest.raises(MismatchError, match="Robotiq85Gripper, but Panda is simulated with PandaGripper; record"),
    ):
        demos[0].object_poses("cube")
    with (
        Demonstrations(_changed(raw, tmp_path / "arm.hdf5", robots="Sawyer")) as demos,
        pytest.raises(MismatchError, match="begins in the home posture of Panda, not of Sawyer; correct `robots`"),
    ):
        demos[0].object_poses("cube")
    with Demonstrations(_changed(raw, tmp_path / "task.hdf5", env_name="NutAssembly")) as demos:
        assert demos.task_name == "NutAssembly"
        with pytest.raises(DatasetError):
            demos[0].object_poses("SquareNut")


def test_a_state_of_another_size_is_told(lift, tmp_path):
    raw = to_raw(lift, tmp_path / "raw.hdf5")
    with h5py.File(raw, "r+") as file:
        states = file["data/demo_0/states"][:]
        del file["data/demo_0/states"]
        file["data/demo_0/states"] = states[:, :-1]
    with Demonstrations(raw) as demos, pytest.raises(DatasetError, match=r"demo_0.*shape \(31,\), expected \(32,\)"):
        demos[0].object_poses("cube")


def test_a_later_recording_that_was_cut_at_its_start_is_not_one_step_late(lift, tmp_path):
    raw = to_raw(lift, tmp_path / "raw.hdf5")
    with h5py.File(raw, "r+") as file:
        for key in ("states", "actions"):
            array = file[f"data/demo_0/{key}"][5:]
            del file[f"data/demo_0/{key}"]
            file[f"data/demo_0/{key}"] = array
    with Demonstrations(lift) as whole, Demonstrations(raw) as demos:
        np.testing.assert_array_equal(demos[0].actions, whole[0].actions[5:])


def test_linked_arrays_are_arrays(lift, tmp_path):
    raw = to_raw(lift, tmp_path / "raw.hdf5")
    with h5py.File(raw, "r+") as file:
        file.move("data/demo_0/states", "kept")
        file["data/demo_0/states"] = h5py.SoftLink("/kept")
        file["data/demo_0/twin"] = file["data/demo_0/actions"]
    with Demonstrations(raw) as demos:
        assert set(demos[0].array_paths) == {"actions", "states", "twin"}


@pytest.mark.parametrize("size", ["nan nan nan", "-1 -1 -1", "0 0 0", "0.03"])
def test_sizes_that_are_none_are_told(lift, tmp_path, size):
    raw = to_raw(lift, tmp_path / "raw.hdf5")
    body = f'<body name="cube_main"><joint name="cube_joint0"/><geom name="cube_g0" type="box" size="{size}"/></body>'
    with h5py.File(raw, "r+") as file:
        file["data/demo_0"].attrs["model_file"] = f"<mujoco><worldbody>{body}</worldbody></mujoco>"
    with Demonstrations(raw) as demos, pytest.raises(DatasetError, match="model_file"):
        demos[0].object_poses("cube")
