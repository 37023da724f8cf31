import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.demos.convert import ConvertSettings, convert_dataset
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import ReadSettings
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, InvalidValueError, MismatchError, OutputError
from ocplanner.files.records.convert import CONVERT_ATTRIBUTE, ConvertRecord
from ocplanner.files.records.labels import LABEL_ATTRIBUTE


@pytest.fixture
def changed(tiny_square, tmp_path):
    """``changed(change, images=True)``: a copy of the synthetic recordings after ``change(file)``."""

    def make(change, version="1.5.1", images=True):
        path = tmp_path / "changed.hdf5"
        shutil.copy(tiny_square(version, images=images), path)
        with h5py.File(path, "r+") as file:
            change(file)
        return path

    return make


def test_a_complete_file_stays_as_it_is(tiny_square, tmp_path):
    path = convert_dataset(tiny_square("1.5.1", images=True), tmp_path / "o.hdf5")
    with h5py.File(tiny_square("1.5.1", images=True)) as source, h5py.File(path) as target:
        paths = []
        source.visititems(lambda path, item: paths.append(path) if isinstance(item, h5py.Dataset) else None)
        assert paths
        for array in paths:
            assert np.array_equal(source[array][()], target[array][()]), array
        for name in source["data"]:
            assert source[f"data/{name}"].attrs["model_file"] == target[f"data/{name}"].attrs["model_file"]
        assert json.loads(source["data"].attrs["env_args"]) == json.loads(target["data"].attrs["env_args"])
        assert target["data"].attrs["total"] == 360
        record = ConvertRecord.from_json(target["data"].attrs[CONVERT_ATTRIBUTE])
    assert record.source == "square_1.5.1_images.hdf5"
    assert not record.flip_images


def test_next_observations_are_those_of_the_next_step(tiny_square, tmp_path):
    path = convert_dataset(tiny_square("1.4.1", images=True), tmp_path / "o.hdf5", ConvertSettings(next_obs=True))
    with Demonstrations(path) as demos:
        demo = demos["demo_10"]
        assert demo.next_observation_keys == demo.observation_keys
        for key in demo.observation_keys:
            now, after = demo.observation(key), demo.next_observation(key)
            assert np.array_equal(after[:-1], now[1:])
            assert np.array_equal(after[-1], now[-1])


def test_flipping_turns_gripper_and_images_and_nothing_else(changed, tmp_path):
    def extras(file):
        for demo in file["data"].values():
            demo["actions_abs"] = demo["actions"][()]
            demo["action_dict/gripper"] = demo["actions"][:, -1:]

    source = changed(extras)
    path = convert_dataset(source, tmp_path / "o.hdf5", ConvertSettings(flip_gripper=True, flip_images=True))
    with h5py.File(source) as before, h5py.File(path) as after:
        was, now = before["data/demo_2"], after["data/demo_2"]
        for key in ("actions", "actions_abs"):
            assert np.array_equal(now[key][:, :-1], was[key][:, :-1])
            assert np.array_equal(now[key][:, -1], -was[key][:, -1])
        assert np.array_equal(now["action_dict/gripper"][()], -was["action_dict/gripper"][()])
        for key in ("obs/agentview_image", "next_obs/agentview_image"):
            assert np.array_equal(now[key][()], was[key][()][:, ::-1])
        assert np.array_equal(now["obs/object"][()], was["obs/object"][()])
        assert np.array_equal(now["states"][()], was["states"][()])


def test_each_arm_of_two_has_its_gripper_flipped(carried_objects, tmp_path):
    path = convert_dataset(carried_objects("TwoArmTransport"), tmp_path / "o.hdf5", ConvertSettings(flip_gripper=True))
    with Demonstrations(carried_objects("TwoArmTransport")) as before, Demonstrations(path) as after:
        sign = np.ones(14)
        sign[[6, 13]] = -1
        assert np.array_equal(after[0].actions, before[0].actions * sign)


def test_what_was_not_recorded_is_not_made_up(carried_objects, changed, tmp_path):
    said = []
    path = convert_dataset(carried_objects("ToolHang"), tmp_path / "o.hdf5", say=said.append)
    with Demonstrations(path) as demos:
        assert np.flatnonzero(demos[0].dones).tolist() == [len(demos[0]) - 1]
        assert "rewards" not in demos[0].array_paths
    assert said == ["left out rewards: none were recorded, and no simulated task gives them"]


def test_what_has_no_place_in_the_layout_is_left_out_and_said(changed, tmp_path):
    def extras(file):
        for demo in file["data"].values():
            demo["datagen_info/subtask"] = np.arange(3)
            demo["note"] = np.array([b"text"] * len(demo["actions"]))

    said = []
    path = convert_dataset(changed(extras), tmp_path / "o.hdf5", say=said.append)
    assert [line.split(":")[0] for line in said] == ["left out datagen_info/subtask", "left out note"]
    with Demonstrations(path) as demos:
        assert "note" not in demos[0].array_paths


def test_a_model_that_is_a_file_name_is_left_out(changed, tmp_path):
    def old(file):
        file["data/demo_0"].attrs["model_file"] = "model_0.xml"

    with Demonstrations(convert_dataset(changed(old), tmp_path / "o.hdf5")) as demos:
        assert "model_file" not in demos["demo_0"].attrs
        assert demos["demo_1"].attrs["model_file"].startswith("<mujoco")


def test_masks_of_a_limited_conversion_name_what_is_there(tiny_square, tmp_path):
    path = convert_dataset(tiny_square(), tmp_path / "o.hdf5", limit=2)
    with Demonstrations(path) as demos:
        assert demos.names == ("demo_0", "demo_1")
        assert demos.mask_names == ("train",)
        assert demos.mask("train") == ["demo_0", "demo_1"]
    with pytest.raises(InvalidValueError, match="limit is 0"):
        convert_dataset(tiny_square(), tmp_path / "p.hdf5", limit=0)


def test_labels_are_not_contradicted(changed, tmp_path):
    source = changed(lambda file: file["data"].attrs.update({LABEL_ATTRIBUTE: "{}"}))
    with pytest.raises(MismatchError, match="convert the data set that was labelled"):
        convert_dataset(source, tmp_path / "o.hdf5", ConvertSettings(flip_gripper=True))
    assert not (tmp_path / "o.hdf5").exists()


def test_turning_images_twice_gives_the_first_ones(tiny_square, tmp_path):
    source, flip = tiny_square("1.4.1", images=True), ConvertSettings(flip_images=True)
    twice = convert_dataset(convert_dataset(source, tmp_path / "once.hdf5", flip), tmp_path / "twice.hdf5", flip)
    with Demonstrations(source) as before, Demonstrations(twice) as after:
        assert np.array_equal(before[0].images("agentview"), after[0].images("agentview"))


def test_images_that_are_not_there_cannot_be_turned(tiny_square, tmp_path):
    with pytest.raises(MismatchError, match="holds no images to turn"):
        convert_dataset(tiny_square(), tmp_path / "o.hdf5", ConvertSettings(flip_images=True))


@pytest.mark.parametrize("array", ["actions", "states", "obs/robot0_eef_pos"])
def test_numbers_that_are_not_finite_are_an_error(changed, tmp_path, array):
    def damage(file):
        file[f"data/demo_1/{array}"][3, 0] = np.nan

    source, said = changed(damage), []
    with pytest.raises(
        DatasetError, match=rf"1 of 4 demonstrations cannot be used.*--skip-bad(.|\n)*demo_1: .*{array}"
    ):
        convert_dataset(source, tmp_path / "o.hdf5")
    convert_dataset(source, tmp_path / "o.hdf5", reading=ReadSettings(skip_bad=True), say=said.append)
    assert said[0].startswith("demo_1 is left out")
    with Demonstrations(tmp_path / "o.hdf5") as demos:
        assert demos.names == ("demo_0", "demo_2", "demo_10")
        assert demos.mask("train") == ["demo_0", "demo_10"]


def test_the_source_is_never_replaced(changed, tmp_path):
    source = changed(lambda file: None)
    before = source.read_bytes()
    with pytest.raises(OutputError):
        convert_dataset(source, source, overwrite=True)
    assert source.read_bytes() == before


def test_an_existing_file_is_replaced_only_on_request(tiny_square, tmp_path):
    path = convert_dataset(tiny_square(), tmp_path / "o.hdf5", limit=1)
    with pytest.raises(OutputError, match="exists already"):
        convert_dataset(tiny_square(), path)
    convert_dataset(tiny_square(), path, overwrite=True)
    with Demonstrations(path) as demos:
        assert len(demos) == 4


def test_a_stopped_conversion_continues(tiny_square, tmp_path, monkeypatch):
    whole = convert_dataset(tiny_square(), tmp_path / "whole.hdf5")
    add, added = DatasetWriter.add, []

    def stop(self, name, *arguments):
        if len(added) == 2:
            raise KeyboardInterrupt
        add(self, name, *arguments)
        added.append(name)

    monkeypatch.setattr(DatasetWriter, "add", stop)
    with pytest.raises(KeyboardInterrupt):
        convert_dataset(tiny_square(), tmp_path / "o.hdf5")
    assert not (tmp_path / "o.hdf5").exists()
    monkeypatch.setattr(DatasetWriter, "add", add)
    told = []
    path = convert_dataset(tiny_square(), tmp_path / "o.hdf5", progress=lambda name, _: told.append(name))
    assert told[:2] == added
    with Demonstrations(path) as demos, Demonstrations(whole) as others:
        for demo, other in zip(demos, others):
            arrays, expected = demo.arrays(), other.arrays()
            assert arrays.keys() == expected.keys()
            assert all(np.array_equal(arrays[key], expected[key]) for key in arrays)
    with pytest.raises(OutputError, match="exists already"):
        convert_dataset(tiny_square(), path, ConvertSettings(next_obs=True))


def test_another_source_of_the_same_name_does_not_continue_a_stopped_conversion(tiny_square, tmp_path):
    def stop(*_):
        raise KeyboardInterrupt

    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        shutil.copy(tiny_square(), tmp_path / folder / "source.hdf5")
    with h5py.File(tmp_path / "other/source.hdf5", "r+") as file:
        file["data/demo_0/actions"][3, 0] = 0.5
    with pytest.raises(KeyboardInterrupt):
        convert_dataset(tmp_path / "one/source.hdf5", tmp_path / "o.hdf5", progress=stop)
    with pytest.raises(OutputError, match="another demo_0 than the source's now"):
        convert_dataset(tmp_path / "other/source.hdf5", tmp_path / "o.hdf5")


def stripped(source: Path, target: Path, *, raw: bool) -> Path:
    """States and actions alone, in robomimic's layout or as robosuite's own recorder writes them."""
    with h5py.File(source) as file, h5py.File(target, "w") as copy:
        env_args, data = file["data"].attrs["env_args"], copy.create_group("data")
        if raw:
            info = {**json.loads(env_args), **json.loads(env_args)["env_kwargs"]}
            version = info.pop("env_version")
            data.attrs.update({"env": info["env_name"], "env_info": json.dumps(info), "repository_version": version})
        else:
            data.attrs["env_args"] = env_args
        for name in ("demo_0", "demo_1"):
            for key in ("states", "actions"):
                data[f"{name}/{key}"] = file[f"data/{name}/{key}"][()]
    return target


@pytest.mark.parametrize("version", ["1.4.1", "1.5.1"])
@pytest.mark.parametrize("raw", [False, True])
def test_what_a_recording_lacks_is_derived_in_its_versions_order(tiny_square, tmp_path, version, raw):
    source = stripped(tiny_square(version), tmp_path / "bare.hdf5", raw=raw)
    path = convert_dataset(source, tmp_path / "o.hdf5", ConvertSettings(next_obs=True))
    with Demonstrations(path) as demos, Demonstrations(source) as bare:
        assert demos.kind == "robomimic"
        assert demos.env_args == bare.env_args
        for demo, other in zip(demos, bare):
            assert demo.derived_keys == ()
            assert {"actions", "states", "rewards", "dones", "obs/object", "next_obs/object"} <= {*demo.array_paths}
            assert demo.object_layout() == ("relative-first" if version == "1.5.1" else "absolute-first")
            absolute = slice(7, 10) if version == "1.5.1" else slice(0, 3)
            expected, _ = other.object_poses("SquareNut")
            assert np.allclose(demo.observation("object")[:, absolute], expected)
            assert np.array_equal(demo.object_poses("SquareNut")[0], expected)
            assert np.array_equal(demo.rewards, other.rewards)


def test_a_real_robots_file_keeps_what_it_holds(tmp_path):
    with h5py.File(tmp_path / "real.hdf5", "w") as file:
        for number in range(2):
            demo = file.create_group(f"data/demo_{number}")
            demo["actions"] = np.full((7, 8), 1.5)
            demo["obs/ee_pos"], demo["obs/arm/joints"] = np.ones((7, 3)), np.ones((7, 6))
            demo["states/arm"], demo["states/base"] = np.ones((7, 6)), np.ones(2)
    said = []
    path = convert_dataset(tmp_path / "real.hdf5", tmp_path / "o.hdf5", say=said.append)
    assert [line.split(":")[0] for line in said] == ["left out rewards", "left out states/base"]
    with Demonstrations(path) as demos:
        assert demos.kind == "other"
        assert {*demos[0].array_paths} == {"actions", "dones", "obs/ee_pos", "obs/arm/joints", "states/arm"}
        assert demos[0].actions.max() == 1.5


@pytest.mark.parametrize("bare", [False, True])
def test_robomimic_loads_and_samples_the_file(tiny_square, tmp_path, bare):
    dataset = pytest.importorskip("robomimic.utils.dataset")
    obs_utils = pytest.importorskip("robomimic.utils.obs_utils")
    source = tiny_square("1.4.1", images=True)
    source = stripped(source, tmp_path / "bare.hdf5", raw=True) if bare else source
    path = convert_dataset(source, tmp_path / "o.hdf5", ConvertSettings(next_obs=True))
    keys = {"low_dim": ["robot0_eef_pos", "object"], "rgb": [] if bare else ["agentview_image"]}
    obs_utils.initialize_obs_utils_with_obs_specs({"obs": keys})
    sequences = dataset.SequenceDataset(
        hdf5_path=str(path),
        obs_keys=[*keys["low_dim"], *keys["rgb"]],
        action_keys=("actions",),
        dataset_keys=("actions", "rewards", "dones"),
        action_config={"actions": {"normalization": None}},
        load_next_obs=True,
        filter_by_attribute=None if bare else "train",
        hdf5_cache_mode=None,
    )
    try:
        assert len(sequences) == (2 if bare else 3) * 90
        item = sequences[5]
        with Demonstrations(path) as demos:
            assert np.allclose(item["actions"][0], demos["demo_0"].actions[5])
            assert np.allclose(item["next_obs"]["object"][0], demos["demo_0"].observation("object")[6])
    finally:
        sequences.close_and_delete_hdf5_handle()
