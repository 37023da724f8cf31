import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import ReadSettings
from ocplanner.errors import DatasetError, MismatchError, UnknownNameError
from ocplanner.planner.config import NetworkConfig, PlannerTraining
from ocplanner.planner.frames import data_settings, future, load_frames, split
from ocplanner.planner.train import train_planner

RENDER = {"visual": "fast", "observe": "masked", "cameras": ["agentview"], "size": 84, "mask_rgb": [255, 0, 255]}


@pytest.fixture(scope="session")
def rendered(tiny_square, tmp_path_factory) -> Path:
    """The synthetic Square data set as ``ocplanner render --observe masked`` writes it."""
    path = tmp_path_factory.mktemp("rendered") / "square.hdf5"
    shutil.copy(tiny_square(images=True), path)
    with h5py.File(path, "a") as file:
        file["data"].attrs["ocplanner_render"] = json.dumps({**RENDER, "silhouettes": ["IIWA"]})
        for demo in file["data"].values():
            image = demo["obs/agentview_image"][()]
            demo["obs/agentview_empty"] = np.maximum(image, 1)
            demo["obs/agentview_mask"] = image[..., 0] > 200
            demo["obs/agentview_silhouettes"] = image[:, None, ..., 1] > 200
    return path


def with_render(path: Path, copy: Path, **changes) -> Path:
    shutil.copy(path, copy)
    with h5py.File(copy, "a") as file:
        file["data"].attrs["ocplanner_render"] = json.dumps({**RENDER, **changes})
    return copy


@given(rows=st.sets(st.integers(0, 29), min_size=1), horizon=st.integers(1, 50))
def test_futures_are_the_next_kept_poses_padded_with_the_last(rows, horizon):
    kept = np.array(sorted(rows))
    positions = np.arange(90.0).reshape(30, 3)
    rotations = np.arange(270.0).reshape(30, 3, 3)
    found = future(positions, rotations, kept, horizon)
    assert found.positions.shape == (len(kept), horizon, 3)
    assert found.rotations.shape == (len(kept), horizon, 3, 3)
    for i in range(len(kept)):
        for k in range(horizon):
            assert np.array_equal(found.positions[i, k], positions[kept[min(i + k + 1, len(kept) - 1)]])


def test_the_visual_preset_is_read_from_the_data_set(rendered, tmp_path):
    for visual in ("stock", None):
        with Demonstrations(with_render(rendered, tmp_path / f"{visual}.hdf5", visual=visual)) as demos:
            assert data_settings(demos, PlannerTraining()).visual == visual


def test_loading_keeps_the_manipulation_only(rendered):
    config = PlannerTraining()
    with Demonstrations(rendered) as demos:
        frames = load_frames(demos, ["demo_0", "demo_2"], config, "SquareNut")
        lengths = [demos[name].length for name in ("demo_0", "demo_2")]
    camera = frames.cameras["agentview"]
    assert 0 < len(frames) < sum(lengths)
    assert camera.scene.shape == (len(frames), 84, 84, 3)
    assert camera.scene.dtype == np.uint8
    assert camera.mask.dtype == bool
    assert camera.silhouettes.shape == (len(frames), 1, 84, 84)
    assert set(frames.demonstration) == {0, 1}
    assert frames.names == ("demo_0", "demo_2")
    first = frames.remaining[frames.demonstration == 0]
    assert first.tolist() == list(range(len(first), 0, -1))


def test_a_demonstration_without_manipulation_is_left_out_on_demand_and_named(rendered, tmp_path):
    path = tmp_path / "idle.hdf5"
    shutil.copy(rendered, path)
    with h5py.File(path, "a") as file:
        for key in ("obs/object", "states", "actions", "obs/robot0_eef_pos", "obs/robot0_eef_quat"):
            array = file[f"data/demo_1/{key}"]
            array[...] = array[10]
    said = []
    with Demonstrations(path) as demos, pytest.raises(DatasetError, match=r"--skip-bad.*\n  demo_1: no manipulation"):
        load_frames(demos, ["demo_0", "demo_1"], PlannerTraining(), "SquareNut")
    with Demonstrations(path, reading=ReadSettings(skip_bad=True)) as demos:
        frames = load_frames(demos, ["demo_0", "demo_1"], PlannerTraining(), "SquareNut", said.append)
        assert frames.names == ("demo_0",)
        assert len(said) == 1
        assert said[0].startswith("demo_1 is left out: ")
        with pytest.raises(DatasetError, match="none of 1 demonstrations"):
            load_frames(demos, ["demo_1"], PlannerTraining(), "SquareNut")


def test_settings_travel(rendered):
    with Demonstrations(rendered) as demos:
        settings = data_settings(demos, PlannerTraining())
    assert settings == ("Square", "SquareNut", "Panda", "fast", (255, 0, 255), ("IIWA",), 20.0)


def test_the_object_can_be_chosen(rendered):
    with Demonstrations(rendered) as demos:
        assert data_settings(demos, PlannerTraining(object="SquareNut")).object_name == "SquareNut"
        with pytest.raises(UnknownNameError, match="SquareNut"):
            data_settings(demos, PlannerTraining(object="tool"))


def test_splits(rendered, tmp_path):
    with Demonstrations(rendered) as demos:
        assert split(demos, 0)[:2] == (["demo_0", "demo_1", "demo_10"], ["demo_2"])
    unsplit = tmp_path / "unsplit.hdf5"
    shutil.copy(rendered, unsplit)
    with h5py.File(unsplit, "a") as file:
        del file["mask"]
    with Demonstrations(unsplit) as demos:
        parts = split(demos, 3)
        assert parts == split(demos, 3)
        assert sorted(parts.train + parts.valid) == sorted(demos.names)
        assert len(parts.valid) == 1
        assert "at random" in parts.source


def test_overlapping_masks_are_refused(rendered, tmp_path):
    path = tmp_path / "overlap.hdf5"
    shutil.copy(rendered, path)
    with h5py.File(path, "a") as file:
        del file["mask/valid"]
        file["mask/valid"] = np.array([b"demo_0"])
    with Demonstrations(path) as demos, pytest.raises(DatasetError, match="share demo_0"):
        split(demos, 0)


def test_data_without_images_names_the_remedy(tiny_square, tmp_path):
    with pytest.raises(DatasetError, match=r"no images.*ocplanner render"):
        train_planner(PlannerTraining(), tiny_square(), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_missing_camera_is_named_with_those_there_are(rendered, tmp_path):
    config = PlannerTraining(cameras=("agentview", "robot0_eye_in_hand"))
    with pytest.raises(DatasetError, match=r"camera robot0_eye_in_hand \(there are: agentview\).*ocplanner render"):
        train_planner(config, rendered, tmp_path / "run")


@pytest.mark.parametrize("observe", ["full", "no-robot"])
def test_another_observation_is_refused(rendered, tmp_path, observe):
    with pytest.raises(MismatchError, match=rf"observe=masked.*--observe {observe}"):
        train_planner(PlannerTraining(observe=observe), rendered, tmp_path / "run")


def test_plain_robomimic_images_count_as_full(tiny_square, tmp_path):
    with pytest.raises(MismatchError, match="shows observe=full"):
        train_planner(PlannerTraining(), tiny_square(images=True), tmp_path / "run")


def test_another_image_size_is_refused(rendered, tmp_path):
    config = PlannerTraining(network=NetworkConfig(image_size=96))
    with pytest.raises(MismatchError, match="84x84, the planner reads 96x96"):
        train_planner(config, rendered, tmp_path / "run")


def test_an_unknown_mask_colour_is_refused(rendered, tmp_path):
    path = with_render(rendered, tmp_path / "colourless.hdf5", mask_rgb=None)
    with pytest.raises(DatasetError, match="mask colour"):
        train_planner(PlannerTraining(), path, tmp_path / "run")


def test_frames_that_were_not_rendered_are_refused(rendered, tmp_path):
    path = with_render(rendered, tmp_path / "black.hdf5")
    with h5py.File(path, "a") as file:
        file["data/demo_1/obs/agentview_empty"][40:45] = 0
    with pytest.raises(DatasetError, match=r"demo_1.*5 of the kept frames.*--frames manipulation"):
        train_planner(PlannerTraining(), path, tmp_path / "run")


def test_a_truncated_file_is_refused(rendered, tmp_path):
    path = tmp_path / "truncated.hdf5"
    path.write_bytes(rendered.read_bytes()[:5000])
    with pytest.raises(DatasetError, match="truncated"):
        train_planner(PlannerTraining(), path, tmp_path / "run")


def test_training_from_a_file(rendered, tmp_path, tiny):
    planner = train_planner(tiny(), rendered, tmp_path / "run")
    assert planner.exists()


def test_replacing_masks_leaves_out_what_is_out_of_reach(frames):
    _, valid = frames
    shown = valid.replace_masks(1)
    reached = valid.cameras["agentview"].silhouettes[:, 1].any(axis=(1, 2))
    assert len(shown) == reached.sum() < len(valid)
    assert np.array_equal(shown.cameras["agentview"].mask, valid.cameras["agentview"].silhouettes[reached, 1])
    with pytest.raises(DatasetError, match="no silhouette 2"):
        valid.replace_masks(2)


def test_the_digest_sees_every_array(frames):
    _, valid = frames
    positions = valid.positions.copy()
    positions[0, 0, 0] += 1e-3
    mask = valid.cameras["agentview"].mask.copy()
    mask[0, 0, 0] ^= True
    cameras = {"agentview": replace(valid.cameras["agentview"], mask=mask)}
    digests = {valid.digest(), replace(valid, positions=positions).digest(), replace(valid, cameras=cameras).digest()}
    assert len(digests) == 3
    assert valid.digest() == valid.take(np.arange(len(valid))).digest()
