"""Whole files or none, one writer at a time, and plain words when a folder cannot be written."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ocplanner.errors import OutputError
from ocplanner.files.storage import atomic_json, atomic_write, check_output, locked, seal, sealed


def test_appears_complete(tmp_path):
    path = tmp_path / "new" / "result.json"
    with atomic_write(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
        temporary.write_text("whole")
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


def test_a_failure_keeps_the_old_content(tmp_path):
    path = tmp_path / "result"
    path.write_text("old")

    def interrupted() -> None:
        with atomic_write(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_json(tmp_path):
    atomic_json(tmp_path / "a.json", {"b": [1, 2.5, None]})
    assert json.loads((tmp_path / "a.json").read_text()) == {"b": [1, 2.5, None]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        atomic_json(tmp_path / "a.json", float("nan"))
    assert json.loads((tmp_path / "a.json").read_text()) == {"b": [1, 2.5, None]}


KILLED = """
import sys, time
from ocplanner.files.storage import atomic_write
with atomic_write(sys.argv[1]) as temporary:
    temporary.write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_left_is_swept_away(tmp_path):
    path = tmp_path / "result"
    with subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"writing\n"
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    assert len(list(tmp_path.iterdir())) == 1
    with atomic_write(path) as temporary:
        temporary.write_text("whole")
    assert list(tmp_path.iterdir()) == [path]


HOLDER = """
import sys, time
from ocplanner.files.storage import locked
with locked(sys.argv[1]):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_one_writer_at_a_time_and_a_kill_frees_the_lock(tmp_path):
    path = tmp_path / "result"
    with subprocess.Popen([sys.executable, "-c", HOLDER, path], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"locked\n"
        with (
            pytest.raises(OutputError, match=rf"another process \(pid {process.pid}\) is writing .*result"),
            locked(path),
        ):
            pass
        process.send_signal(signal.SIGKILL)
    with locked(path):
        pass
    assert list(tmp_path.iterdir()) == []


def _count(path: str, counter: str, rounds: int) -> None:
    for _ in range(rounds):
        while True:
            try:
                with locked(path):
                    with open(counter, "r+") as file:
                        value = int(file.read() or 0)
                        file.seek(0)
                        file.write(str(value + 1))
                    break
            except OutputError:
                time.sleep(0.0005)


def test_the_lock_excludes(tmp_path):
    counter = tmp_path / "counter"
    counter.write_text("0")
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_count, args=(str(tmp_path / "x"), str(counter), 150)) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert counter.read_text() == "450"


@pytest.mark.parametrize("writer", [lambda path: atomic_json(path, {}), lambda path: locked(path).__enter__()])
def test_impossible_paths(tmp_path, writer):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="choose another output"):
        writer(tmp_path / "file" / "result.json")


READ_ONLY = """
import os, sys
from ocplanner.errors import OutputError
from ocplanner.files.storage import atomic_json, locked
os.chdir(sys.argv[1])
if os.geteuid() == 0:
    os.seteuid(65534)  # root may write anywhere
for attempt in (lambda: atomic_json("result.json", {}), lambda: locked("result.json").__enter__()):
    try:
        attempt()
    except OutputError as error:
        print(error)
"""


def test_read_only_folder(tmp_path):
    folder = tmp_path / "read-only"
    folder.mkdir()
    folder.chmod(0o555)
    done = subprocess.run([sys.executable, "-c", READ_ONLY, folder], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == 2
    assert all("cannot write result.json" in line and "choose another output folder" in line for line in lines)
    assert os.listdir(folder) == []


FULL = """
import resource, sys
from ocplanner.files.storage import atomic_write
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
from ocplanner.errors import OutputError
try:
    with atomic_write(sys.argv[1]) as temporary:
        temporary.write_bytes(bytes(10**6))
except OutputError as error:
    print(error)
"""


def test_no_room(tmp_path):
    path = tmp_path / "result"
    done = subprocess.run([sys.executable, "-c", FULL, path], capture_output=True, text=True, check=True)
    assert f"cannot write {path}" in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [0, 1, 3 << 20])
def test_a_seal_tells_damage(tmp_path, size):
    path = tmp_path / "part"
    path.write_bytes(np.random.default_rng(0).bytes(size))
    assert not sealed(path)
    seal(path)
    assert sealed(path)
    content = bytearray(path.read_bytes())
    assert len(content) == size + 32
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert not sealed(path)


@pytest.mark.parametrize(
    ("kind", "name", "content"),
    [
        ("HDF5 data set", "a.hdf5", b"\x89HDF\r\n\x1a\n" + bytes(8)),
        ("JSON result", "a.json", b'{"command": "ocplanner transfer"}'),
        ("HTML page", "a.html", b"\n<!DOCTYPE html><html></html>"),
        ("picture", "a.png", b"\x89PNG\r\n"),
        ("picture", "a.svg", b'<?xml version="1.0"?>\n<svg>'),
        ("mp4 video", "a.mp4", bytes(3) + b"\x20ftypisom"),
        ("safetensors file", "a.safetensors", bytes([80]) + bytes(7) + b'{"__metadata__"'),
    ],
)
def test_only_a_file_of_the_kind_that_is_written_is_replaced(tmp_path, kind, name, content):
    path = tmp_path / name
    check_output(path, False, kind)
    path.touch()
    check_output(path, True, kind)
    path.write_bytes(content)
    check_output(path, True, kind)
    with pytest.raises(OutputError, match="exists already; choose another file, or allow overwriting"):
        check_output(path, False, kind)
    for other in (b"notes", b'{"train": {}}', b"{", b"[]", bytes(600)):
        path.write_bytes(other)
        with pytest.raises(OutputError, match=f"exists already and is no {kind}"):
            check_output(path, True, kind)


def test_a_lock_needs_a_name():
    with pytest.raises(OutputError, match="names no file or folder of its own"), locked("/"):
        pass
