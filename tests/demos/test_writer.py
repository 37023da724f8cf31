"""What the writer promises: complete or absent, nothing lost but the demonstration in flight, one process at a time."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import DatasetError, OutputError
from ocplanner.files.records.render import RenderRecord

ENV_ARGS = {"env_name": "Lift", "env_version": "1.5.2", "type": 1, "env_kwargs": {"robots": ["Panda"]}}


def _arrays(seed: int = 0, steps: int = 5) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "actions": rng.uniform(-1, 1, (steps, 7)),
        "states": rng.normal(size=(steps, 32)),
        "obs/agentview_image": rng.integers(0, 256, (steps, 8, 8, 3), dtype=np.uint8),
        "obs/agentview_mask": rng.random((steps, 8, 8)) < 0.5,
    }


def test_round_trip(tmp_path):
    path = tmp_path / "set.hdf5"
    model = "<mujoco/>" * 20_000  # longer than HDF5's 64 KiB of compact attributes
    with DatasetWriter(path, ENV_ARGS, data_attrs={"ocplanner_render": json.dumps({"size": 8})}) as writer:
        for seed in (10, 2, 0):
            writer.add(f"demo_{seed}", _arrays(seed, 5 + seed), {"model_file": model, "seed": seed})
        assert writer.done == ("demo_0", "demo_2", "demo_10")
        assert not path.exists()
        writer.finish({"train": ["demo_0", "demo_10"], "valid": ["demo_2"]})
    assert list(tmp_path.iterdir()) == [path]
    demos = Demonstrations(path)
    assert demos.names == ("demo_0", "demo_2", "demo_10")
    assert (demos.env_args, demos.render_record, demos.attrs["total"]) == (ENV_ARGS, RenderRecord(size=8), 5 + 7 + 15)
    assert (demos.mask("train"), demos.mask("valid")) == (["demo_0", "demo_10"], ["demo_2"])
    for demo in demos:
        assert (demo.attrs["seed"], demo.attrs["num_samples"]) == (int(demo.name[5:]), demo.length)
        assert demo.attrs["model_file"] == model
        stored = demo.arrays()
        for key, array in _arrays(int(demo.name[5:]), demo.length).items():
            np.testing.assert_array_equal(stored.pop(key), array, strict=True)
        assert stored == {}
    with h5py.File(path) as file:
        assert file["data/demo_2/obs/agentview_image"].chunks == (1, 8, 8, 3)  # random access to frames


def test_a_copy_with_some_arrays_changed(tiny_square, tmp_path):
    source = Demonstrations(tiny_square("1.5.1", True))
    rewards, added = np.arange(90.0), np.ones((90, 2, 3), np.float32)
    with DatasetWriter(tmp_path / "copy.hdf5", source.env_args) as writer:
        with pytest.raises(DatasetError, match=r"demo_1: rewards has shape \(89,\), but there are 90 actions"):
            writer.add_copy(source["demo_1"], {"rewards": rewards[:89]})
        writer.add_copy(source["demo_1"], {"rewards": rewards, "obs/added": added})
        writer.finish()
    with Demonstrations(tmp_path / "copy.hdf5") as copy:
        stored, before = copy["demo_1"].arrays(), source["demo_1"].arrays()
        assert copy["demo_1"].attrs == source["demo_1"].attrs
        np.testing.assert_array_equal(stored.pop("obs/added"), added, strict=True)
        for key, array in {**before, "rewards": rewards}.items():
            np.testing.assert_array_equal(stored.pop(key), array, strict=True)
        assert stored == {}


@pytest.mark.parametrize("version", ["1.4.1", "1.5.1"])
def test_copies_any_data_set(tiny_square, tmp_path, version):
    source = Demonstrations(tiny_square(version, True))
    with DatasetWriter(tmp_path / "copy.hdf5", source.env_args) as writer:
        for demo in source:
            writer.add(demo.name, demo.arrays(), demo.attrs)
        writer.finish({mask: source.mask(mask) for mask in source.mask_names})
    copy = Demonstrations(tmp_path / "copy.hdf5")
    assert copy.names == source.names
    for demo in source:
        assert copy[demo.name].attrs == demo.attrs
        for key, array in demo.arrays().items():
            np.testing.assert_array_equal(copy[demo.name].arrays()[key], array, strict=True)


def test_resumes_only_what_was_made_alike(tmp_path):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS, data_attrs={"ocplanner_render": "84"}) as writer:
        writer.add("demo_0", _arrays())
    with DatasetWriter(path, ENV_ARGS, data_attrs={"ocplanner_render": "84"}) as writer:
        assert writer.done == ("demo_0",)
    with pytest.raises(OutputError, match="made with another ocplanner_render; run with the settings as before"):
        DatasetWriter(path, ENV_ARGS, data_attrs={"ocplanner_render": "96"})


def test_existing_files_are_kept_unless_told(tmp_path):
    path = tmp_path / "set.hdf5"
    path.write_text("precious")
    with pytest.raises(OutputError, match="exists already and is no HDF5 data set"):
        DatasetWriter(path, ENV_ARGS, overwrite=True)
    with h5py.File(path, "w") as file:
        file["old"] = 1
    before = path.read_bytes()
    with pytest.raises(OutputError, match=r"exists already.*--overwrite"):
        DatasetWriter(path, ENV_ARGS)
    with DatasetWriter(path, ENV_ARGS, overwrite=True) as writer:
        writer.add("demo_0", _arrays())
        assert path.read_bytes() == before
        writer.finish()
    assert Demonstrations(path).names == ("demo_0",)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("../demo", {}, "cannot name a demonstration"),
        ("demo_0", {"actions": None}, "no actions among its arrays .states"),
        ("demo_0", {"actions": np.zeros((0, 7))}, "no steps"),
        ("demo_0", {"states": np.zeros((4, 3))}, r"states has shape \(4, 3\), but there are 5 actions"),
        ("demo_0", {"obs/text": np.full(5, "x")}, "obs/text has dtype <U1"),
    ],
)
def test_what_is_no_demonstration(tmp_path, name, change, message):
    arrays = {key: array for key, array in {**_arrays(), **change}.items() if array is not None}
    with DatasetWriter(tmp_path / "set.hdf5", ENV_ARGS) as writer:
        with pytest.raises(DatasetError, match=message):
            writer.add(name, arrays)
        assert writer.done == ()


def test_finish_wants_what_it_names(tmp_path):
    with DatasetWriter(tmp_path / "set.hdf5", ENV_ARGS) as writer:
        with pytest.raises(DatasetError, match="without any demonstration"):
            writer.finish()
        writer.add("demo_0", _arrays())
        with pytest.raises(DatasetError, match="without demo_1; add what is missing"):
            writer.finish({"train": ["demo_0", "demo_1"]})
        assert writer.done == ("demo_0",)


def test_without_a_demonstration_nothing_stays(tmp_path):
    with DatasetWriter(tmp_path / "set.hdf5", ENV_ARGS) as writer:
        assert writer.parts.is_dir()
    assert not writer.parts.exists()
    with DatasetWriter(tmp_path / "set.hdf5", ENV_ARGS) as writer:
        writer.add("demo_0", _arrays())
    assert writer.done == ("demo_0",)


WRITER = """
import sys
import numpy as np
from ocplanner.demos.writer import DatasetWriter
rng = np.random.default_rng(0)
arrays = {"actions": np.zeros((40, 7)), "obs/agentview_image": rng.integers(0, 256, (40, 84, 84, 3), dtype=np.uint8)}
with DatasetWriter(sys.argv[1], {"env_name": "Lift"}) as writer:
    print("start", flush=True)
    for index in range(int(sys.argv[2])):
        name = f"demo_{index}"
        if name not in writer.done:
            writer.add(name, {**arrays, "rewards": np.full(40, float(index))})
            print(name, flush=True)
    print("finish", flush=True)
    writer.finish({"train": ["demo_0"]})
"""


def _start(path: Path, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITER, str(path), str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_kill_at_any_moment_loses_at_most_the_demonstration_in_flight(tmp_path):
    path, count = tmp_path / "set.hdf5", 6
    reported: set[str] = set()
    kills = 0
    delays = iter([*np.random.default_rng(0).uniform(0.0, 0.06, 10), *np.linspace(0.1, 20, 20)])
    while not path.exists():
        with _start(path, count) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(next(delays))
            process.send_signal(signal.SIGKILL)
            lines = process.stdout.read().split()
        kills += 1
        reported |= set(lines) - {"finish"}
        parts = path.with_name("set.hdf5.parts")
        if not path.exists():
            assert reported <= {part.stem for part in parts.glob("*.hdf5")}  # nothing reported was lost
    assert kills > 2
    with Demonstrations(path) as demos:
        assert len(demos) == count
        for index, demo in enumerate(demos):
            assert set(demo.rewards) == {float(index)}
            assert demo.images("agentview").shape == (40, 84, 84, 3)


def test_two_processes_on_one_output(tmp_path):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS) as writer:
        done = subprocess.run(
            [sys.executable, "-c", WRITER, str(path), "1"], capture_output=True, text=True, check=False
        )
        assert done.returncode == 1
        assert "OutputError: another process (pid" in done.stderr
        writer.add("demo_0", _arrays())
        writer.finish()
    assert len(Demonstrations(path)) == 1


FULL = """
import resource, sys
import numpy as np
from ocplanner.demos.writer import DatasetWriter
from ocplanner.errors import OutputError
from ocplanner.files.records.render import RenderRecord
rng = np.random.default_rng(0)
with DatasetWriter(sys.argv[1], {"env_name": "Lift"}) as writer:
    writer.add("demo_0", {"actions": rng.normal(size=(4_000, 7))})
    writer.add("demo_1", {"actions": rng.normal(size=(4_000, 7))})
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
    for attempt in (lambda: writer.add("demo_2", {"actions": rng.normal(size=(9_000, 7))}), writer.finish):
        try:
            attempt()
        except OutputError as error:
            print(error)
    print(*writer.done)
"""


@pytest.mark.parametrize("limit", [0, 100, 4_000, 100_000, 250_000, 300_000])
def test_no_room_keeps_what_was_added(tmp_path, limit):
    path = tmp_path / "set.hdf5"
    command = [sys.executable, "-c", FULL, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert len(lines) == 3, done.stderr
    assert all(f"cannot write {path}" in line and "raise the limit" in line for line in lines[:2])
    assert lines[2] == "demo_0 demo_1"
    assert [entry.name for entry in tmp_path.iterdir()] == ["set.hdf5.parts"]
    with DatasetWriter(path, {"env_name": "Lift"}) as writer:
        writer.finish()
    assert [demo.length for demo in Demonstrations(path)] == [4_000, 4_000]


def test_a_damaged_part_is_named_and_made_again(tmp_path):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS) as writer:
        for seed in range(2):
            writer.add(f"demo_{seed}", _arrays(seed))
        part = writer.parts / "demo_1.hdf5"
    content = bytearray(part.read_bytes())
    content[content.index(_arrays(1)["actions"].tobytes())] ^= 1
    part.write_bytes(content)
    with pytest.raises(OutputError, match=r"demo_1\.hdf5: damaged since written; delete it"):
        DatasetWriter(path, ENV_ARGS)
    assert part.read_bytes() == content
    part.unlink()
    with DatasetWriter(path, ENV_ARGS) as writer:
        assert writer.done == ("demo_0",)


@pytest.mark.parametrize("header", [b"", b"[1]", b"\xff"])
def test_a_damaged_header_is_named(tmp_path, header):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS) as writer:
        writer.add("demo_0", _arrays())
        (writer.parts / "header.json").write_bytes(header)
    with pytest.raises(OutputError, match=r"header\.json is damaged .*delete"):
        DatasetWriter(path, ENV_ARGS)


@pytest.mark.parametrize("removed", [(), ("header.json",), ("header.json", "demo_0.hdf5")])
def test_a_kill_while_the_parts_are_removed_leaves_nothing(tmp_path, removed):
    path, kept = tmp_path / "set.hdf5", tmp_path / "kept"
    with DatasetWriter(path, ENV_ARGS) as writer:
        for seed in range(2):
            writer.add(f"demo_{seed}", _arrays(seed))
        shutil.copytree(writer.parts, kept)
        writer.finish()
    for name in removed:
        (kept / name).unlink()
    kept.rename(writer.parts)
    with pytest.raises(OutputError, match="exists already"):
        DatasetWriter(path, ENV_ARGS)
    assert list(tmp_path.iterdir()) == [path]


def test_parts_that_are_to_replace_a_file_stay(tmp_path):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS) as writer:
        writer.add("demo_0", _arrays())
        writer.finish()
    with DatasetWriter(path, {**ENV_ARGS, "env_version": "1.5.1"}, overwrite=True) as writer:
        writer.add("demo_0", _arrays())
    with pytest.raises(OutputError, match="exists already"):
        DatasetWriter(path, ENV_ARGS)
    assert len(list(writer.parts.iterdir())) == 2


def test_parts_made_from_another_source_are_not_resumed(tmp_path):
    path = tmp_path / "set.hdf5"
    with DatasetWriter(path, ENV_ARGS) as writer:
        writer.add("demo_0", _arrays(0), source="first")
        writer.add("demo_1", _arrays(1))
    with DatasetWriter(path, ENV_ARGS) as writer:
        assert writer.holds("demo_0", "first")
        assert not writer.holds("demo_2", "first")
        for name in ("demo_0", "demo_1"):
            with pytest.raises(OutputError, match=f"{name}.hdf5 was made from another {name} than the source's now"):
                writer.holds(name, "second")
        writer.finish()
    with h5py.File(path) as file:
        assert {*file} == {"data"}
        assert {*file["data/demo_0"].attrs} == {"num_samples"}


def test_a_folder_of_parts_with_other_files_is_left_alone(tmp_path):
    folder = tmp_path / "set.hdf5.parts"
    folder.mkdir()
    (folder / "notes.txt").write_text("precious")
    with pytest.raises(OutputError, match=r"set.hdf5.parts holds notes.txt"):
        DatasetWriter(tmp_path / "set.hdf5", ENV_ARGS)
    assert (folder / "notes.txt").read_text() == "precious"


def test_what_others_keep_in_a_folder_of_parts_stays(tmp_path):
    target, parts = tmp_path / "out.hdf5", tmp_path / "out.hdf5.parts"
    parts.mkdir()
    (parts / "mine.hdf5").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"holds mine\.hdf5"):
        DatasetWriter(target, {"env_name": "Lift"})
    assert (parts / "mine.hdf5").read_bytes() == b"mine"


def test_attributes_of_any_type_are_kept(tmp_path):
    attrs = {"num_demos": np.int64(3), "sizes": np.array([1.0, 2.0]), "share": np.float32(0.5)}
    with DatasetWriter(tmp_path / "out.hdf5", {"env_name": "Lift"}, data_attrs=attrs) as writer:
        writer.add("demo_0", {"actions": np.zeros((3, 7))})
        writer.finish()
    with h5py.File(tmp_path / "out.hdf5") as file:
        assert file["data"].attrs["num_demos"] == 3
        assert file["data"].attrs["sizes"].tolist() == [1.0, 2.0]
