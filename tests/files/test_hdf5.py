"""What went wrong while reading: damage, memory, another writer, or our own mistake."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

from ocplanner.errors import DatasetError
from ocplanner.files import hdf5
from ocplanner.files.hdf5 import HDF5File

WRITER = """
import sys, time, h5py
with h5py.File(sys.argv[1], "r+", libver="latest" if sys.argv[2] == "swmr" else None) as file:
    if sys.argv[2] == "swmr":
        file.swmr_mode = True
    print("open", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def path(tmp_path) -> Path:
    path = tmp_path / "set.hdf5"
    with h5py.File(path, "w") as file:
        file["data/numbers"] = np.arange(10.0)
        file["data"].create_dataset("huge", shape=(10**13,), dtype="f8", chunks=(1000,))
        scalar = h5py.h5s.create(h5py.h5s.SCALAR)
        h5py.h5d.create(file["data"].id, b"moment", h5py.h5t.UNIX_D32LE.copy(), h5py.h5s.create_simple((4,)))
        h5py.h5a.create(file["data/numbers"].id, b"made", h5py.h5t.UNIX_D32LE.copy(), scalar)
    return path


@contextmanager
def writer(path: Path, kind: str) -> Iterator[int]:
    """The writing process's number."""
    command = [sys.executable, "-c", WRITER, str(path), kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"open\n"
        try:
            yield process.pid
        finally:
            process.kill()


def test_an_array_larger_than_memory_is_not_called_damage(path):
    with pytest.raises(DatasetError) as caught:
        HDF5File(path).read("data/huge")
    assert "data/huge: not enough memory (Unable to allocate 72.8 TiB" in str(caught.value)
    assert "; free some memory or use fewer workers" in str(caught.value)


def test_rows_of_an_array_larger_than_memory_are_read(path):
    assert HDF5File(path).read("data/huge", slice(10, 12)).tolist() == [0, 0]


@pytest.mark.parametrize("kind", ["locked", "swmr"])
def test_a_file_that_is_being_written_is_not_called_damaged(path, kind):
    if kind == "swmr":
        with h5py.File(path, "w", libver="latest") as file:
            file["data/numbers"] = np.arange(10.0)
    with writer(path, kind), pytest.raises(DatasetError, match=r"set\.hdf5: .* has it open for writing") as caught:
        HDF5File(path).read("data/numbers")
    assert ("HDF5_USE_FILE_LOCKING=FALSE" in str(caught.value)) == (kind == "locked")
    assert "download" not in str(caught.value)


def test_a_lock_is_told_with_the_process_that_holds_it(path):
    with writer(path, "locked") as number, pytest.raises(DatasetError) as caught:
        HDF5File(path).read("data/numbers")
    assert f"process {number} ({sys.executable} -c" in str(caught.value)
    assert "has it open for writing; wait until that has finished, or end it" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_lock_whose_holder_is_not_seen_may_be_the_file_systems_fault(path, monkeypatch):
    monkeypatch.setattr(hdf5, "_holders", lambda _: [])
    with writer(path, "locked"), pytest.raises(DatasetError, match="None is seen on this machine"):
        HDF5File(path).read("data/numbers")


def test_the_remedy_for_a_lock_works(path, monkeypatch):
    with writer(path, "locked"):
        monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
        code = f"from ocplanner.files.hdf5 import HDF5File; print(HDF5File({str(path)!r}).read('data/numbers').sum())"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "45.0\n"


def test_a_mistake_in_the_program_stays_one(path):
    with pytest.raises(TypeError, match="increasing order"):
        HDF5File(path).read("data/numbers", np.array([3, 1]))


def _wrong_attribute(path: Path) -> None:
    with HDF5File(path).reading("data") as handle:
        handle.no_such_method()


def test_a_missing_method_stays_a_mistake(path):
    with pytest.raises(AttributeError, match="no_such_method"):
        _wrong_attribute(path)


@pytest.mark.parametrize(
    "read",
    [lambda file: file.names("data"), lambda file: file.arrays("/"), lambda file: file.read("data/absent")],
    ids=["names", "arrays", "read"],
)
def test_a_name_that_is_no_text_is_the_files_fault(path, read):
    with h5py.File(path, "r+") as file:
        h5py.h5g.create(file["data"].id, b"\xff\xfe")
        file["data"].move("numbers", b"\xff")
    with pytest.raises(DatasetError, match=r"holds a name that is not UTF-8; .*download or record it again"):
        read(HDF5File(path))


@pytest.mark.parametrize("read", [lambda file: file.read("data/moment"), lambda file: file.attributes("data/numbers")])
def test_a_type_that_numpy_lacks_is_the_files_fault(path, read):
    with pytest.raises(DatasetError, match=r"of an unknown type .*download or record it again"):
        read(HDF5File(path))


def test_a_folder_is_not_called_missing(tmp_path):
    with pytest.raises(DatasetError, match=r"a folder, not an HDF5 file; .*`ocplanner convert SOURCE TARGET`"):
        HDF5File(tmp_path).read("data")
