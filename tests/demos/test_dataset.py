"""Reading robomimic files of every version, across processes, and what is said about broken ones."""

import json
import multiprocessing
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.settings import ReadSettings
from ocplanner.errors import DatasetError, UnknownNameError
from ocplanner.files.records.render import RenderRecord

VERSIONS = ("1.2.0", "1.4.1", "1.5.1")


@pytest.fixture
def copy(tiny_square: Callable[..., Path], tmp_path: Path) -> Path:
    return Path(shutil.copy(tiny_square(), tmp_path / "copy.hdf5"))


@pytest.mark.parametrize("version", VERSIONS)
def test_reads_every_version_alike(tiny_square, version):
    reference = Demonstrations(tiny_square("1.4.1"))
    with Demonstrations(tiny_square(version)) as demos:
        assert demos.names == ("demo_0", "demo_1", "demo_2", "demo_10")  # natural order
        assert (demos.task_name, demos.env_name, demos.robots) == ("Square", "NutAssemblySquare", ("Panda",))
        assert demos.env_version == version
        assert demos.mask("train") == ["demo_0", "demo_1", "demo_10"]
        assert (demos.cameras, demos.render_record, demos.observe) == ((), None, "full")
        for demo in demos:
            positions, rotations = demo.object_poses("SquareNut")
            expected, turned = reference[demo.name].object_poses("SquareNut")
            np.testing.assert_array_equal(positions, expected)
            np.testing.assert_allclose(rotations, turned, atol=1e-12)
            np.testing.assert_array_equal(positions, demo.states[:, 10:13])
            assert demo.actions.shape == (demo.length, 7)
            assert demo.rewards.shape == demo.dones.shape == (len(demo),)
            assert demo.eef_positions.shape == (len(demo), 3)
            assert ("model_file" in demo.attrs) == (version >= "1.5")


def test_indexing(tiny_square):
    demos = Demonstrations(tiny_square())
    assert demos[3].name == demos[-1].name == demos[np.int64(3)].name == "demo_10"
    assert [demo.name for demo in demos[:2]] == ["demo_0", "demo_1"]
    with pytest.raises(DatasetError, match="the file has 4, from demo_0 to demo_10"):
        demos["demo_7"]
    with pytest.raises(IndexError):
        demos[4]


def test_images_and_their_absence(tiny_square):
    demos = Demonstrations(tiny_square(images=True))
    assert demos.cameras == ("agentview",)
    images = demos["demo_1"].images("agentview")
    assert (images.shape, images.dtype) == ((90, 84, 84, 3), np.uint8)
    np.testing.assert_array_equal(demos["demo_1"].images("agentview", slice(3, 5)), images[3:5])
    with pytest.raises(DatasetError, match=r"no images of camera 'frontview'.*ocplanner render.*agentview"):
        demos[0].images("frontview")


def test_named_sensors_are_preferred(copy):
    with h5py.File(copy, "r+") as file:
        obs = file["data/demo_0/obs"]
        obs["SquareNut_pos"] = obs["object"][:, :3]
        obs["SquareNut_quat"] = obs["object"][:, 3:7]
        del obs["object"]
    demo = Demonstrations(copy)[0]
    np.testing.assert_array_equal(demo.object_poses("SquareNut")[0], demo.states[:, 10:13])


def test_unknown_names_list_the_known(tiny_square):
    demos = Demonstrations(tiny_square())
    with pytest.raises(UnknownNameError, match="'RoundNut'; known: SquareNut"):
        demos[0].object_poses("RoundNut")
    with pytest.raises(DatasetError, match="no such mask; the file has: train, valid"):
        demos.mask("test")
    with pytest.raises(DatasetError, match="no such observation; the file has: object, robot0_eef_pos"):
        demos[0].observation("robot0_joint_pos")


def _sums(demos: Demonstrations) -> list[float]:
    return [float(demo.actions.sum()) for demo in demos]


def test_pickles_by_path(tiny_square):
    demos = Demonstrations(tiny_square())
    expected = _sums(demos)
    assert _sums(pickle.loads(pickle.dumps(demos))) == expected  # noqa: S301


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_works_in_forked_processes(tiny_square):
    demos = Demonstrations(tiny_square())
    expected = _sums(demos)  # the file is open in this process
    with multiprocessing.get_context("fork").Pool(3) as pool:
        assert pool.map(_sums, [demos] * 6) == [expected] * 6
    assert _sums(demos) == expected


def test_what_is_no_data_set(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        Demonstrations(tmp_path / "absent.hdf5")
    (tmp_path / "text.hdf5").write_text("not HDF5")
    with pytest.raises(DatasetError, match="not a readable HDF5 file"):
        Demonstrations(tmp_path / "text.hdf5")


def _read_everything(path: Path) -> None:
    with Demonstrations(path) as demos:
        for demo in demos:
            demo.arrays()
            demo.object_poses("SquareNut")
        demos.mask("train")


def test_every_truncation_is_an_error(copy):
    whole = copy.read_bytes()
    for size in np.linspace(0, len(whole) - 1, 60, dtype=int):
        copy.write_bytes(whole[:size])
        with pytest.raises(DatasetError, match=r"copy\.hdf5"):
            _read_everything(copy)


def test_holes_are_errors_or_harmless(copy):
    """A file of full length whose tail was never written: a copy cut off after preallocation."""
    whole = copy.read_bytes()
    messages = []
    for size in np.linspace(96, len(whole) - 1, 60, dtype=int):
        copy.write_bytes(whole[:size] + bytes(len(whole) - size))
        try:
            _read_everything(copy)
        except DatasetError as error:
            messages.append(str(error))
    assert len(messages) > 30
    assert all("copy.hdf5" in message for message in messages)


def _delete(key: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(key)


def _replace(key: str, array: np.ndarray) -> Callable[[h5py.File], None]:
    def damage(file: h5py.File) -> None:
        del file[key]
        file[key] = array

    return damage


def _set(key: str, index: object, value: float) -> Callable[[h5py.File], None]:
    return lambda file: file[key].__setitem__(index, value)


def _env_args(text: str) -> Callable[[h5py.File], None]:
    return lambda file: file["data"].attrs.__setitem__("env_args", text)


def _group_for_actions(file: h5py.File) -> None:
    del file["data/demo_0/actions"]
    file.create_group("data/demo_0/actions")


def _no_demonstrations(file: h5py.File) -> None:
    del file["data/demo_0"], file["data/demo_1"], file["data/demo_2"], file["data/demo_10"]


def _nothing_seen(file: h5py.File) -> None:
    del file["data/demo_0/obs"], file["data/demo_0/states"]


def _nothing(file: h5py.File) -> None:
    del file["data"].attrs["env_args"], file["data/demo_0/actions"]


OBJECT, ACTIONS, STATES = (f"data/demo_0/{key}" for key in ("obs/object", "actions", "states"))
FAULTS = {
    "no data": (_delete("data"), "data: no such group"),
    "no demonstrations": (_no_demonstrations, "no demonstration"),
    "env_args no JSON": (_env_args("{"), "not JSON"),
    "env_args a list": (_env_args("[]"), r"no object \(list\)"),
    "no env_name": (_env_args("{}"), "no object with an env_name"),
    "no actions": (_delete(ACTIONS), "actions: not there.*obs.*rewards.*states"),
    "neither obs nor states": (_nothing_seen, "states: not there; data/demo_0 holds: actions"),
    "nothing": (_nothing, "no attribute env_args, and no demonstration with actions"),
    "short states": (_replace(STATES, np.zeros((3, 45))), r"\(3, 45\), but there are 90"),
    "flat actions": (_replace(ACTIONS, np.zeros(90)), "expected 2 dimension"),
    "wide actions": (_replace(ACTIONS, np.zeros((90, 8))), r"expected \(steps, 7\)"),
    "NaN action": (_set(ACTIONS, (4, 2), np.nan), r"actions: nan at \[4, 2\]"),
    "infinite state": (_set(STATES, (4, 2), np.inf), r"states: inf at \[4, 2\]"),
    "text": (_replace(ACTIONS, np.full((90, 7), b"x")), "expected numbers"),
    "zero quaternion": (_set(OBJECT, (5, slice(3, 7)), 0), "pose is damaged .*quaternion"),
    "narrow object": (_replace(OBJECT, np.zeros((90, 10))), r"expected \(steps, 14\)"),
    "group for array": (_group_for_actions, "not an array"),
    "mask of others": (_replace("mask/train", np.array([b"demo_99"])), "names demo_99"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_name_file_key_and_remedy(copy, fault):
    damage, message = FAULTS[fault]
    with h5py.File(copy, "r+") as file:
        damage(file)

    def read() -> None:
        with Demonstrations(copy) as demos:
            demo = demos["demo_0"]
            _ = demo.actions, demo.states, demo.rewards, demo.dones
            demo.object_poses("SquareNut")
            demos.mask("train")

    with pytest.raises(DatasetError, match=message) as caught:
        read()
    assert str(copy) in str(caught.value)
    assert "; " in str(caught.value)


def test_the_record_of_rendering(copy):
    with h5py.File(copy, "r+") as file:
        file["data"].attrs["ocplanner_render"] = json.dumps({"observe": "masked", "size": 84})
    with Demonstrations(copy) as demos:
        assert (demos.render_record, demos.observe) == (RenderRecord("masked", size=84), "masked")
    for damaged in ("{", "[]", '{"size": "84"}', '{"observe": "x-ray"}'):
        with h5py.File(copy, "r+") as file:
            file["data"].attrs["ocplanner_render"] = damaged
        match = r"ocplanner_render of data: cannot be read.*; render the data set again"
        with Demonstrations(copy) as demos, pytest.raises(DatasetError, match=match):
            _ = demos.render_record


def test_square_ph(square_ph):
    demos = Demonstrations(square_ph)
    assert (len(demos), demos.attrs["total"]) == (200, 30154)
    assert (len(demos.mask("train")), len(demos.mask("valid"))) == (180, 20)
    for name in ("demo_0", "demo_191"):
        positions, rotations = demos[name].object_poses("SquareNut")
        np.testing.assert_array_equal(positions, demos[name].states[:, 10:13])
        np.testing.assert_allclose(np.linalg.det(rotations), 1, atol=1e-12)


def test_a_file_that_does_not_say_its_task_gives_what_it_holds(copy):
    with h5py.File(copy, "r+") as file:
        del file["data"].attrs["env_args"]
        del file["data/demo_0/states"]
        file.create_group("data/demo_0/states")
        del file["data/demo_1/states"]
        file["data/demo_1/states"] = np.zeros(1)
    with Demonstrations(copy) as demos:
        assert (demos.kind, demos.env_name, demos.robots) == ("other", "", ())
        for demo in demos:
            assert demo.actions.shape == (90, 7)
            assert demo.observation("robot0_eef_pos").shape == (90, 3)
        with pytest.raises(DatasetError, match=r"does not say its task.*train-policy --low-dim"):
            demos.task()


def test_a_mask_lists_each_demonstration_once(copy):
    with h5py.File(copy, "r+") as file:
        del file["mask/train"]
        file["mask/train"] = np.array([b"demo_1", b"demo_0", b"demo_1"])
    with Demonstrations(copy) as demos:
        assert demos.mask("train") == ["demo_0", "demo_1"]
        assert demos.listed("train") == ["demo_1", "demo_0", "demo_1"]


def test_what_a_mask_names_in_vain_can_be_skipped(copy):
    with h5py.File(copy, "r+") as file:
        del file["mask/train"]
        file["mask/train"] = np.array([b"demo_1", b"demo_99"])
    with Demonstrations(copy, reading=ReadSettings(skip_bad=True)) as demos:
        assert demos.mask("train") == ["demo_1"]
    with Demonstrations(copy) as demos, pytest.raises(DatasetError, match=r"demo_99.*--skip-bad"):
        demos.mask("train")


def test_other_names_of_observations(copy, tmp_path):
    with h5py.File(copy, "r+") as file:
        for name in file["data"]:
            file.move(f"data/{name}/obs/robot0_eef_pos", f"data/{name}/obs/ee_pos")
    names = tmp_path / "keys.json"
    names.write_text('{"robot0_eef_pos": "ee_pos"}')
    with Demonstrations(copy, reading=ReadSettings(keys=names)) as demos:
        assert "robot0_eef_pos" in demos[0].observation_keys
        np.testing.assert_array_equal(demos[0].eef_positions, demos[0].observation("ee_pos"))
    faults = {"{": "cannot be read", "[1]": "no object of texts", '{"a": 1}': "no object of texts"}
    faults['{"robot0_eef_pos": "eef"}'] = "no eef, which .*keys.json gives for robot0_eef_pos; the file has: ee_pos"
    for text, fault in faults.items():
        names.write_text(text)
        with pytest.raises(DatasetError, match=fault):
            Demonstrations(copy, reading=ReadSettings(keys=names))
