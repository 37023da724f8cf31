import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest

import ocplanner as ocp
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import DatasetError, InvalidValueError, OutputError
from ocplanner.files.records.labels import ActionScale
from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.settings import LabelSettings

SETTINGS = LabelSettings(horizon_steps=(1, 4), reward="augment")


def content(path: Path) -> str:
    digest = hashlib.sha256()

    def take(name: str, item: h5py.Group | h5py.Dataset) -> None:
        attributes = {key: str(value) for key, value in item.attrs.items()}
        digest.update(f"{name} {sorted(attributes.items())}".encode())
        if isinstance(item, h5py.Dataset):
            digest.update(f"{item.dtype} {item.shape}".encode() + item[()].tobytes())

    with h5py.File(path) as file:
        take("/", file)
        file.visititems(take)
    return digest.hexdigest()


@pytest.fixture(scope="module")
def source(tiny_square) -> Path:
    return tiny_square("1.4.1", images=True)


@pytest.fixture(scope="module")
def labelled(source, noise_planner, tmp_path_factory) -> Path:
    return label_dataset(source, tmp_path_factory.mktemp("labelled") / "out.hdf5", noise_planner, SETTINGS)


def test_the_copy_has_everything_and_the_labels(source, labelled, noise_planner):
    with Demonstrations(source) as before, Demonstrations(labelled) as after:
        assert after.names == before.names
        assert after.env_args == before.env_args
        assert {m: after.mask(m) for m in after.mask_names} == {m: before.mask(m) for m in before.mask_names}
        assert after.attrs["total"] == 360
        for one, other in zip(before, after):
            arrays, copied = one.arrays(), other.arrays()
            assert other.attrs == one.attrs
            for key, array in arrays.items():
                np.testing.assert_array_equal(copied["rewards_sparse" if key == "rewards" else key], array)
            assert set(copied) - set(arrays) == {
                "rewards_sparse",
                "ocp_reward_position",
                "ocp_reward_rotation",
                "obs/ocp_hint",
                "obs/ocp_plan",
                *(f"next_obs/{key}" for key in (*one.observation_keys, "ocp_hint", "ocp_plan")),
            }
            assert (other.rewards != one.rewards).sum() > 30
            assert other.observation("ocp_hint").shape == (90, 13)


def test_what_was_done_is_recorded(labelled, noise_planner):
    with Demonstrations(labelled) as demos:
        said = demos.label_record
    assert said is not None
    assert said.planner_sha256 == noise_planner.sha256
    assert LabelSettings.of(said) == SETTINGS
    assert said.action_scale == ActionScale(0.05, 0.5)
    assert said.ocp_hint == ("k=1: x y z", "k=1: rx ry rz", "k=4: x y z", "k=4: rx ry rz", "held")
    assert said.source is not None
    assert said.source.name == "square_1.4.1_images.hdf5"


def test_a_killed_run_goes_on_and_ends_the_same(source, labelled, noise_planner, tmp_path):
    target = tmp_path / "out.hdf5"
    process = multiprocessing.get_context("spawn").Process(
        target=_label_and_die, args=(source, target, noise_planner.path, SETTINGS)
    )
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not target.exists()
    assert len(list((tmp_path / "out.hdf5.parts").glob("*.hdf5"))) == 2
    seen = []
    label_dataset(source, target, noise_planner, SETTINGS, progress=lambda name, steps: seen.append((name, steps)))
    assert seen == [(name, 90) for name in ("demo_0", "demo_1", "demo_2", "demo_10")]
    assert content(target) == content(labelled)
    assert not (tmp_path / "out.hdf5.parts").exists()


def _label_and_die(source: Path, target: Path, planner: Path, settings: LabelSettings) -> None:
    def die(name: str, _: int) -> None:
        if name == "demo_1":
            os.kill(os.getpid(), signal.SIGKILL)

    label_dataset(source, target, planner, settings, progress=die)


@pytest.mark.parametrize("where", ["source", "pictures"])
@pytest.mark.parametrize("key", ["rewards", "obs/robot0_gripper_qpos", "obs/agentview_image"])
def test_another_source_of_the_same_names_and_size_does_not_go_on(source, noise_planner, tmp_path, where, key):
    files = {}
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        files[folder] = shutil.copy(source, tmp_path / folder / source.name)
    with h5py.File(files["second"], "r+") as file:
        file[f"data/demo_0/{key}"][-1] = 1 - file[f"data/demo_0/{key}"][-1]
    target = tmp_path / "out.hdf5"

    def label(folder: str, progress=None) -> None:
        path = files[folder]
        first, pictures = (path, None) if where == "source" else (source, path)
        label_dataset(first, target, noise_planner, SETTINGS, pictures=pictures, progress=progress)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        label("first", stop)
    with pytest.raises(
        OutputError, match=r"demo_0.hdf5 was made from another demo_0.*delete .*out.hdf5.parts to start"
    ):
        label("second")
    label("first")
    assert Demonstrations(target).names == ("demo_0", "demo_1", "demo_2", "demo_10")


def test_other_settings_do_not_go_on(source, noise_planner, tmp_path):
    target = tmp_path / "out.hdf5"

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        label_dataset(source, target, noise_planner, SETTINGS, progress=stop)
    with pytest.raises(OutputError, match="another ocplanner_label"):
        label_dataset(source, target, noise_planner, LabelSettings(horizon_steps=(2,)))
    label_dataset(source, target, noise_planner, SETTINGS, limit=1)
    with Demonstrations(target) as demos:
        assert demos.names == ("demo_0",)
        assert demos.mask_names == ("train",)


def test_targets_and_sources_that_are_refused(source, labelled, noise_planner, tmp_path):
    with pytest.raises(OutputError, match="exists"):
        label_dataset(source, labelled, noise_planner, SETTINGS)
    with pytest.raises(OutputError, match="is read to make the output and is never replaced"):
        label_dataset(source, source, noise_planner, SETTINGS, overwrite=True)
    with pytest.raises(DatasetError, match="labelled already"):
        label_dataset(labelled, tmp_path / "again.hdf5", noise_planner, SETTINGS)
    with pytest.raises(InvalidValueError, match="at least 1"):
        label_dataset(source, tmp_path / "none.hdf5", noise_planner, SETTINGS, limit=0)
    assert not list(tmp_path.iterdir())


def test_ten_times_the_file_needs_no_more_memory(source, noise_planner, tmp_path):
    big = tmp_path / "big.hdf5"
    shutil.copy(source, big)
    with h5py.File(big, "r+") as file:
        for number in range(20, 56):
            file.copy("data/demo_1", file["data"], name=f"demo_{number}")
        file["data"].attrs["total"] = 40 * 90
    peaks = []
    for path in (source, big):
        tracemalloc.start()
        label_dataset(path, tmp_path / f"labelled_{path.name}", noise_planner, SETTINGS)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]


def test_at_the_top_of_the_package():
    assert ocp.label_dataset is label_dataset
    assert ocp.LabelSettings is LabelSettings


@pytest.mark.filterwarnings("ignore")
def test_robomimic_reads_it(labelled):
    from robomimic.utils import dataset, obs_utils

    low_dim = ["robot0_eef_pos", "object", "ocp_hint"]
    obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": low_dim, "rgb": ["agentview_image"]}})
    read = dataset.SequenceDataset(
        str(labelled),
        obs_keys=[*low_dim, "agentview_image"],
        action_keys=["actions"],
        dataset_keys=["actions", "rewards", "dones"],
        action_config={"actions": {"normalization": None}},
        filter_by_attribute="train",
        load_next_obs=True,
        hdf5_cache_mode=None,
    )
    assert len(read) == 3 * 90
    sample = read[40]
    with Demonstrations(labelled) as demos:
        np.testing.assert_array_equal(sample["obs"]["ocp_hint"][0], demos["demo_0"].observation("ocp_hint")[40])
        np.testing.assert_array_equal(sample["next_obs"]["ocp_hint"][0], demos["demo_0"].observation("ocp_hint")[41])
        np.testing.assert_array_equal(sample["rewards"][0], demos["demo_0"].rewards[40])


def test_it_says_so_in_json(labelled):
    with h5py.File(labelled) as file:
        assert json.loads(file["data"].attrs["ocplanner_label"])["settings"]["hints"] is True
