"""Workers of real Ray clusters on this machine."""

import importlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ocplanner as ocp
from ocplanner.errors import ClusterError, MismatchError, VersionError, WorkerError
from ocplanner.rollouts import ray_cluster, ray_pool
from ocplanner.rollouts.episodes import run_episodes
from ocplanner.rollouts.settings import WorkerSettings
from random_planner import write_random_planner

SEEDS = range(4)
TOKEN = uuid.uuid4().hex
"""Ray reads it once in a process: all clusters of these tests share it."""


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def processes_naming(text: str) -> list[str]:
    """Command lines of the running processes that hold a text."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            lines.append(path.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
        except OSError:
            continue
    return [line for line in lines if text in line]


@pytest.fixture(scope="module", autouse=True)
def _environment() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", TOKEN)
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        yield


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a cluster with two processor cores; afterwards nothing of it is left."""
    with tempfile.TemporaryDirectory(prefix="ocp-ray-", ignore_cleanup_errors=True) as folder:
        address = f"127.0.0.1:{free_port()}"
        options = [
            "--num-cpus=2",
            f"--ray-client-server-port={free_port()}",
            "--include-dashboard=false",
            f"--object-store-memory={80 * 2**20}",
            "--block",
        ]
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", f"--temp-dir={folder}", *options]
        log = Path(folder, "start.log")
        with log.open("wb") as stream:
            head = subprocess.Popen([*command, f"--port={address.split(':')[1]}"], stdout=stream, stderr=stream)
            try:
                while "Ray runtime started" not in log.read_text():
                    assert head.poll() is None, log.read_text()
                    time.sleep(0.1)
                yield address
            finally:
                head.terminate()
                head.wait(60)
        deadline = time.monotonic() + 30
        while processes_naming(folder) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert processes_naming(folder) == []


@pytest.fixture
def connected(cluster: str) -> Iterator[str]:
    """Its address, when this process is connected already."""
    ray = importlib.import_module("ray")
    ray.init(address=cluster, logging_level="ERROR", log_to_driver=False)
    yield cluster
    assert ray.is_initialized(), "a connection of the caller's stays"
    ray.shutdown()


def lift() -> Any:
    return ocp.make_env("Lift", cameras=())


def push(env: Any, seed: int) -> list[float]:
    env.reset(seed)
    for _ in range(3):
        env.step(np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.0, 1.0]))
    return [*env.object_pose().position, *env.eef_pose().position]


def dies_midway(folder: Path, env: Any, seed: int) -> list[float]:
    """The first try of seed 2 kills its process half done; later ones find the trace of that."""
    if seed == 2 and not (folder / "died").exists():
        env.reset(seed)
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return push(env, seed)


def nothing() -> None:
    pass


def double(context: None, seed: int) -> int:
    return 2 * seed


def refuses(context: None, seed: int) -> int:
    raise MismatchError("no")


def dies_always(context: None, seed: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def locks(context: None, seed: int) -> Any:
    """A result that cannot be pickled."""
    return threading.Lock()


def always_fails(folder: Path, context: None, seed: int) -> int:
    """Two tries kill their process, the third raises what no episode should."""
    tries = len(list(folder.iterdir()))
    (folder / str(tries)).touch()
    if tries < 2:
        os.kill(os.getpid(), signal.SIGKILL)
    raise ZeroDivisionError("a mistake in the episode")


def test_a_killed_worker_changes_nothing(cluster, tmp_path):
    here = dict(run_episodes(lift, push, SEEDS))
    there = dict(run_episodes(lift, partial(dies_midway, tmp_path), SEEDS, WorkerSettings(2, cluster)))
    assert (tmp_path / "died").exists()
    assert there == here
    assert not importlib.import_module("ray").is_initialized()


def test_more_workers_than_the_cluster_has_room_for(connected):
    assert dict(run_episodes(nothing, double, range(5), WorkerSettings(3, connected))) == {
        seed: 2 * seed for seed in range(5)
    }


def test_what_goes_wrong_comes_through(connected, tmp_path, monkeypatch):
    with pytest.raises(MismatchError, match="no"):
        list(run_episodes(nothing, refuses, [0, 1], WorkerSettings(2, connected)))
    with pytest.raises(WorkerError, match="seed 0 failed: ZeroDivisionError: a mistake in the episode") as caught:
        list(run_episodes(nothing, partial(always_fails, tmp_path), [0], WorkerSettings(ray=connected)))
    assert "always_fails" in caught.value.__notes__[0]
    with pytest.raises(WorkerError, match="seed 0 killed its worker 3 times"):
        list(run_episodes(nothing, dies_always, [0], WorkerSettings(ray=connected)))
    with pytest.raises(WorkerError, match=r"seed 0 failed: .*cannot pickle"):
        list(run_episodes(nothing, locks, [0], WorkerSettings(ray=connected)))
    monkeypatch.setattr(ray_pool, "installed", lambda: {"mujoco": "3.2.0"})
    with pytest.raises(ClusterError, match=r"mujoco .* instead of 3\.2\.0"):
        list(run_episodes(nothing, refuses, [0], WorkerSettings(ray=connected)))


def test_a_cluster_of_its_own_lasts_as_long_as_the_episodes(monkeypatch):
    with tempfile.TemporaryDirectory(prefix="ocp-ray-", ignore_cleanup_errors=True) as folder:
        monkeypatch.setenv("RAY_TMPDIR", folder)
        assert dict(run_episodes(nothing, double, [3], WorkerSettings(ray="local"))) == {3: 6}
        assert processes_naming(folder) == []


@pytest.mark.parametrize("address", ["127.0.0.1:{port}", "nonsense"])
def test_an_address_without_a_cluster_is_told(monkeypatch, address):
    monkeypatch.setattr(ray_cluster, "_PATIENCE_S", 4)
    address = address.format(port=free_port())
    with pytest.raises(ClusterError, match=f"{address}.*ray start --head"):
        list(run_episodes(nothing, refuses, [0], WorkerSettings(ray=address)))


@pytest.mark.parametrize("verb", ["collect", "render", "transfer"])
def test_commands_hand_the_address_on(tiny_square, tmp_path, capsys, verb):
    from ocplanner.cli import main

    planner, out = tmp_path / "p.safetensors", str(tmp_path / "out.json")
    write_random_planner(planner)
    arguments = {
        "collect": ["--out", out],
        "render": [str(tiny_square("1.5.1")), out],
        "transfer": ["--planner", str(planner), "--out", out],
    }
    assert main([verb, *arguments[verb], "--ray", "nonsense"]) == 2
    assert "no Ray cluster can be reached at 'nonsense'" in capsys.readouterr().err


def test_a_missing_ray_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(VersionError, match=r"ocplanner\[ray\]"):
        list(run_episodes(nothing, refuses, [0], WorkerSettings(ray="auto")))
