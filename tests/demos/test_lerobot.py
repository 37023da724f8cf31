"""What needs lerobot runs where ``OCPLANNER_LEROBOT_PYTHON`` names a Python that has it (``make test-lerobot``)."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.demos.convert import ConvertSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.lerobot import LeRobotSettings, from_lerobot, is_lerobot, to_lerobot
from ocplanner.demos.lerobot_layout import paths_of, unpack
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, OutputError, UnknownNameError, VersionError

VIDEO_ERROR = 4.0
"""Mean difference of a smooth picture after lerobot's own video compression, of 255."""


@pytest.fixture(scope="session")
def python() -> Path:
    named = os.environ.get("OCPLANNER_LEROBOT_PYTHON")
    if named is None and importlib.util.find_spec("lerobot") is None:
        pytest.skip("lerobot cannot be installed beside robosuite: `make test-lerobot` runs this")
    return Path(named or sys.executable)


@pytest.fixture(scope="session")
def source(tiny_square, tmp_path_factory) -> Path:
    """Three short demonstrations whose pictures move smoothly."""
    path = tmp_path_factory.mktemp("lerobot") / "source.hdf5"
    shutil.copy(tiny_square("1.5.1", images=True), path)
    rows, columns = np.mgrid[:84, :84]
    with h5py.File(path, "r+") as file:
        for number, name in enumerate(("demo_0", "demo_1", "demo_10")):
            demo = file[f"data/{name}"]
            steps = 20 + number
            pictures = [(np.sin((rows + t) / 20), np.cos((columns - t) / 15), rows / 84) for t in range(steps)]
            images = np.stack([np.stack(picture, axis=-1) * 100 + 120 for picture in pictures]).astype(np.uint8)
            arrays = {"obs/agentview_image": images, "ocp_extra": np.arange(steps)}
            paths: list[str] = []
            demo.visititems(lambda path, item, paths=paths: paths.append(path) if hasattr(item, "shape") else None)
            for key in paths:
                arrays.setdefault(key, demo[key][:steps])
                del demo[key]
            for key, array in arrays.items():
                demo[key] = array
            demo.attrs["num_samples"] = steps
        del file["data/demo_2"], file["mask/valid"]
    return path


@pytest.fixture(scope="session")
def lossless(source, python, tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("lossless") / "square"
    settings = LeRobotSettings(images="png", repo_id="someone/square", instruction="put the nut on the peg")
    return to_lerobot(source, target, settings, python=python)


def same(one: Path, other: Path, *, pictures: float = 0.0) -> None:
    with Demonstrations(one) as before, Demonstrations(other) as after:
        assert after.names == before.names
        assert after.env_args == before.env_args
        assert {mask: after.mask(mask) for mask in after.mask_names} == {
            mask: before.mask(mask) for mask in before.mask_names
        }
        for demo, back in zip(before, after):
            assert back.attrs["model_file"] == demo.attrs["model_file"]
            was, now = demo.arrays(), back.arrays()
            assert now.keys() == {path for path in was if not path.startswith("next_obs/")}
            for path, array in now.items():
                assert array.shape == was[path].shape
                if path.endswith("_image"):
                    off = np.abs(array.astype(int) - was[path])
                    assert array.dtype == np.uint8
                    assert off.mean() <= pictures
                elif path in ("states", "ocp_extra", "dones"):
                    assert np.array_equal(array, was[path])
                else:
                    assert np.array_equal(array, was[path].astype(np.float32)), path


def test_a_round_trip_through_png_keeps_everything(source, lossless, python, tmp_path):
    same(source, from_lerobot(lossless, tmp_path / "back.hdf5", python=python))


def test_a_round_trip_through_video_keeps_all_but_some_of_the_pictures(source, python, tmp_path):
    said = []
    folder = to_lerobot(source, tmp_path / "square", python=python, say=said.append)
    assert said == []
    assert list(folder.glob("videos/observation.images.agentview/**/*.mp4"))
    back = from_lerobot(folder, tmp_path / "back.hdf5", python=python)
    same(source, back, pictures=VIDEO_ERROR)
    with Demonstrations(source) as before, Demonstrations(back) as after:
        was, now = before["demo_1"].images("agentview").astype(int), after["demo_1"].images("agentview")
        off = np.abs(was[:, None] - now[None]).mean(axis=(2, 3, 4))
        assert off.argmin(axis=1).tolist() == list(range(21))  # each frame is its own, not its neighbour
    assert not list(tmp_path.glob(".square*"))


def test_lerobot_sees_what_its_policies_expect(source, lossless, python):
    info = json.loads((lossless / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["fps"] == 20
    assert info["robot_type"] == "Panda"
    features = info["features"]
    assert features["observation.state"]["names"][:2] == ["robot0_eef_pos.0", "robot0_eef_pos.1"]
    assert features["observation.state"]["shape"] == [9]
    assert features["observation.environment_state"]["names"] == [f"object.{i}" for i in range(14)]
    assert features["observation.images.agentview"]["dtype"] == "image"
    assert features["action"]["names"][-1] == "robot0.gripper"
    assert features["hdf5.states"]["dtype"] == "float64"
    script = (
        "from lerobot.datasets.lerobot_dataset import LeRobotDataset; import sys, json\n"
        "data = LeRobotDataset('someone/square', root=sys.argv[1])\n"
        "item = data[25]\n"
        "print(json.dumps([item['task'], int(item['episode_index']), item['action'].tolist(), len(data)]))\n"
    )
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    ran = subprocess.run([python, "-c", script, lossless], env=environment, capture_output=True, text=True, check=True)
    task, episode, action, steps = json.loads(ran.stdout.splitlines()[-1])
    assert (task, episode, steps) == ("put the nut on the peg", 1, 63)
    with Demonstrations(source) as demos:
        assert np.array_equal(np.float32(action), np.float32(demos["demo_1"].actions[5]))


def test_what_is_mended_on_the_way_there_or_back_is_the_same(source, python, tmp_path):
    settings = ConvertSettings(flip_gripper=True, flip_images=True)
    png = LeRobotSettings(images="png")
    there = to_lerobot(source, tmp_path / "there", png, settings, python=python, limit=1)
    there = from_lerobot(there, tmp_path / "there.hdf5", python=python)
    plain = to_lerobot(source, tmp_path / "plain", png, python=python, limit=1)
    settings = ConvertSettings(flip_gripper=True, flip_images=True, next_obs=True)
    back = from_lerobot(plain, tmp_path / "back.hdf5", settings, python=python)
    with Demonstrations(there) as one, Demonstrations(back) as other, Demonstrations(source) as before:
        arrays, others = one[0].arrays(), other[0].arrays()
        assert all(np.array_equal(arrays[key], others[key]) for key in arrays)
        assert np.array_equal(arrays["actions"][:, 6], -np.float32(before[0].actions[:, 6]))
        assert np.array_equal(arrays["obs/agentview_image"], before[0].images("agentview")[:, ::-1])
        assert "next_obs/object" in others


def test_a_stopped_conversion_from_lerobot_continues(lossless, python, tmp_path, monkeypatch):
    add, added = DatasetWriter.add, []

    def stop(self, name, *arguments):
        if added:
            raise KeyboardInterrupt
        add(self, name, *arguments)
        added.append(name)

    monkeypatch.setattr(DatasetWriter, "add", stop)
    with pytest.raises(KeyboardInterrupt):
        from_lerobot(lossless, tmp_path / "back.hdf5", python=python)
    monkeypatch.setattr(DatasetWriter, "add", add)
    told: list[str] = []
    from_lerobot(lossless, tmp_path / "back.hdf5", python=python, progress=lambda name, _: told.append(name))
    assert told == ["demo_0", "demo_1", "demo_10"]


def test_a_stopped_conversion_to_lerobot_leaves_nothing(source, python, tmp_path):
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        to_lerobot(source, tmp_path / "square", python=python, progress=stop)
    assert not list(tmp_path.iterdir())


def test_only_a_lerobot_data_set_is_replaced(source, lossless, python, tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("years")
    for overwrite, message in ((False, "exists already; choose"), (True, "is no LeRobot data set")):
        with pytest.raises(OutputError, match=message):
            to_lerobot(source, mine, python=python, overwrite=overwrite)
    assert (mine / "thesis.tex").read_text() == "years"
    shutil.copytree(lossless, tmp_path / "old")
    to_lerobot(source, tmp_path / "old", LeRobotSettings(images="png"), python=python, overwrite=True, limit=1)
    assert json.loads((tmp_path / "old/meta/info.json").read_text())["total_episodes"] == 1
    with pytest.raises(OutputError, match=r"holds .*source.hdf5, which is read"):
        to_lerobot(source, source.parent, python=python, overwrite=True)


def test_anothers_data_set_becomes_one_without_env_args(lossless, python, tmp_path):
    folder = shutil.copytree(lossless, tmp_path / "foreign")
    (folder / "meta/ocplanner.json.gz").unlink()
    said: list[str] = []
    path = from_lerobot(folder, tmp_path / "foreign.hdf5", python=python, say=said.append)
    with h5py.File(path) as file:
        assert "env_args" not in file["data"].attrs
        assert file["data"].attrs["fps"] == 20
        assert set(file["data"]) == {"demo_0", "demo_1", "demo_2"}
        assert file["data/demo_0"].attrs["task"] == "put the nut on the peg"
        assert {"robot0_eef_pos", "object", "agentview_image"} <= set(file["data/demo_0/obs"])
    again = to_lerobot(path, tmp_path / "again", LeRobotSettings(images="png"), python=python, limit=1)
    tasks = from_lerobot(again, tmp_path / "again.hdf5", python=python)
    with Demonstrations(path) as before, Demonstrations(tasks) as after:
        assert after.kind == "other"
        assert after[0].attrs["task"] == "put the nut on the peg"
        assert after[0].array_paths == before[0].array_paths


def test_changed_episodes_and_damage_are_told(lossless, python, tmp_path):
    folder = shutil.copytree(lossless, tmp_path / "damaged")
    ours = folder / "meta/ocplanner.json.gz"
    whole = ours.read_bytes()
    ours.write_bytes(whole[:100])
    with pytest.raises(DatasetError, match=r"ocplanner.json.gz is damaged .*; remove meta"):
        from_lerobot(folder, tmp_path / "o.hdf5", python=python)
    ours.write_bytes(whole)
    shutil.rmtree(folder / "data")
    with pytest.raises(DatasetError, match=r"lerobot failed .* check that the data set is whole"):
        from_lerobot(folder, tmp_path / "o.hdf5", python=python)


def test_odd_pictures_fit_no_video(source, python, tmp_path):
    path = shutil.copy(source, tmp_path / "odd.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            images = demo["obs/agentview_image"][:, :83]
            del demo["obs/agentview_image"], demo["next_obs"]
            demo["obs/agentview_image"] = images
    with pytest.raises(MismatchError, match="84 x 83; use --images png"):
        to_lerobot(path, tmp_path / "square", python=python)
    assert is_lerobot(to_lerobot(path, tmp_path / "square", LeRobotSettings(images="png"), python=python, limit=1))


def test_without_lerobot_the_error_says_where_to_get_it(source, tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(VersionError, match=r"lerobot/bin/pip install 'lerobot\[dataset\]'.*--lerobot-python"):
        to_lerobot(source, tmp_path / "square")
    with pytest.raises(VersionError, match=r"cannot run .*no_python"):
        to_lerobot(source, tmp_path / "square", python=tmp_path / "no_python")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is not None, reason="this Python has lerobot")
def test_a_python_without_lerobot_is_told(source, tmp_path):
    with pytest.raises(VersionError, match=r"has no lerobot that works .ModuleNotFoundError"):
        to_lerobot(source, tmp_path / "square", python=Path(sys.executable))
    assert not list(tmp_path.iterdir())


def test_a_vector_is_taken_apart_only_by_names_of_ours():
    state = {"dtype": "float32", "shape": [3], "names": ["a.0", "a.1", "b.0"]}
    features = {"action": {"dtype": "float32", "shape": [2], "names": None}, "observation.state": state}
    file = {"action": np.ones((4, 2)), "observation.state": np.arange(12.0).reshape(4, 3)}
    paths = paths_of(features, {})
    arrays = unpack(file, features, paths, [])
    assert arrays["obs/a"].tolist() == file["observation.state"][:, :2].tolist()
    assert arrays["obs/b"].shape == (4, 1)
    assert arrays["dones"].tolist() == [0, 0, 0, 1]
    for names in (
        ["shoulder.pos", "elbow.pos", "gripper.pos"],
        None,
        {"motors": ["x", "y", "z"]},
        ["a.1", "a.0", "b.0"],
    ):
        state["names"] = names
        assert unpack(file, features, paths, [])["obs/state"].shape == (4, 3)


def test_features_without_a_place_have_no_path():
    features = {
        "action": {"dtype": "float32", "shape": [2]},
        "observation.images.top.left": {"dtype": "video", "shape": [48, 64, 3]},
        "observation.images.depth": {"dtype": "video", "shape": [48, 64, 1]},
        "observation.effort": {"dtype": "float64", "shape": [2]},
        "task_description": {"dtype": "string", "shape": [1]},
        "language_events": {"dtype": "language", "shape": [1]},
        "next.success": {"dtype": "bool", "shape": [1]},
    }
    assert paths_of(features, {}) == {
        "action": "actions",
        "observation.images.top.left": "obs/top_left_image",
        "observation.effort": "obs/effort",
        "next.success": "next_success",
    }
    with pytest.raises(DatasetError, match=r"no feature .action. among action\.arm"):
        paths_of({"action.arm": features["action"]}, {})


def test_settings_are_checked(source, tiny_square, tmp_path):
    with pytest.raises(UnknownNameError, match="gif"):
        LeRobotSettings(images="gif")
    with pytest.raises(InvalidValueError, match="fps is 0"):
        LeRobotSettings(fps=0)
    with pytest.raises(MismatchError, match="recorded at 20 Hz, not 10; leave out --fps"):
        to_lerobot(source, tmp_path / "square", LeRobotSettings(fps=10), python=Path(sys.executable))
    with pytest.raises(InvalidValueError, match="leave out --next-obs"):
        to_lerobot(source, tmp_path / "square", conversion=ConvertSettings(next_obs=True))
    with pytest.raises(DatasetError, match="no LeRobot data set"):
        from_lerobot(tmp_path, tmp_path / "o.hdf5")
    assert not list(tmp_path.iterdir())


def test_the_frequency_is_recorded_or_measured_or_given(source, tmp_path):
    path = shutil.copy(source, tmp_path / "unknown.hdf5")
    with h5py.File(path, "r+") as file:
        env_args = json.loads(file["data"].attrs["env_args"])
        del env_args["env_kwargs"]["control_freq"]
        file["data"].attrs["env_args"] = json.dumps(env_args)
    with pytest.raises(MismatchError, match="recorded at 20 Hz, not 5"):  # the times of the states say so
        to_lerobot(path, tmp_path / "square", LeRobotSettings(fps=5), python=Path(sys.executable))
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            del demo["states"]
    with pytest.raises(InvalidValueError, match="does not say how many steps a second has; give it: --fps"):
        to_lerobot(path, tmp_path / "square", python=Path(sys.executable))
