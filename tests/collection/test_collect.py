import json

import h5py
import numpy as np
import pytest

from ocplanner.collection import collect as collecting
from ocplanner.collection.collect import collect
from ocplanner.collection.settings import CollectSettings
from ocplanner.control.grasp_detection import held_steps
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.layouts import split_object
from ocplanner.errors import DatasetError
from ocplanner.rollouts.settings import WorkerSettings


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    path = tmp_path_factory.mktemp("collect") / "square.hdf5"
    return collect(path, CollectSettings(episodes=2), WorkerSettings(2))


def test_records_successes_in_the_layout_of_1_5(collected):
    assert collected.demonstrations == 2
    with Demonstrations(collected.path) as demos:
        assert demos.robots == ("Panda",)
        assert demos.env_version is not None
        assert demos.env_version.startswith("1.5")
        assert sorted(demos.mask("train") + demos.mask("valid")) == sorted(demos.names)
        for demo in demos:
            assert demo.rewards[-1] == 1.0
            assert np.abs(demo.actions).max() <= 1
            positions, _ = demo.object_poses("SquareNut")
            segment = demo.manipulation()
            assert 40 < segment.stop - segment.start < 200
            assert np.abs(positions - demo.states[:, 10:13]).max() < 1e-9


def test_does_not_depend_on_the_workers(collected, tmp_path):
    again = collect(tmp_path / "one.hdf5", CollectSettings(episodes=2))
    with Demonstrations(collected.path) as two, Demonstrations(again.path) as one:
        assert one.names == two.names
        for name in one.names:
            assert np.array_equal(one[name].states, two[name].states)


@pytest.mark.parametrize(
    ("task", "main", "shortest"), [("Lift", "cube", 10), ("Can", "Can", 40), ("Stack", "cubeA", 30)]
)
def test_records_the_other_tasks(tmp_path, task, main, shortest):
    collected = collect(tmp_path / "other.hdf5", CollectSettings(task, episodes=2, noise=0.5))
    with Demonstrations(collected.path) as demos:
        assert demos.task_name == task
        said = json.loads(demos.attrs["ocplanner_collect"])
        assert (said["expert"], said["task"], said["robot"]) == ("scripted", task, "Panda")
        assert (said["seed"], said["first_seed"], said["noise"], said["flaw"]) == (0, 0, 0.5, None)
        for demo in demos:
            assert demo.rewards[-1] == 1.0
            positions, _ = demo.object_poses(main)
            order = demo.object_layout()
            assert order is not None
            vector = split_object(demo.observation("object"), demos.env_name, main, order)
            assert np.abs(positions - vector[:, :3]).max() < 1e-9  # by name and in `object`: the same
            segment = demo.manipulation()
            assert shortest < segment.length < 150
            let_go = demo.actions[-1, 6] == -1
            assert let_go == (task != "Lift")  # there the cube is kept up


FIVE = CollectSettings(episodes=5, seed=2)


@pytest.fixture
def toy(monkeypatch):
    """Attempts that need no simulator; every third fails."""

    class Env:
        def close(self):
            pass

    monkeypatch.setattr(collecting, "make_env", lambda *_, **__: Env())
    monkeypatch.setattr(collecting, "_env_args", lambda *_: {"env_name": "NutAssemblySquare"})

    def record(env, seed, flaw=None, noise=1.0):
        return None if seed % 3 == 1 else {"actions": np.full((4, 7), seed / 1e4)}

    monkeypatch.setattr(collecting, "record", record)


def test_failures_are_left_out_and_counted(toy, tmp_path):
    tried = []
    collected = collect(tmp_path / "d.hdf5", FIVE, progress=lambda name, ok: tried.append((name, ok)))
    with h5py.File(collected.path) as file:
        assert sorted(file["data"]) == ["demo_0", "demo_1", "demo_3", "demo_4", "demo_6"]  # 2002, 2005 fail
        assert file["data/demo_3"].attrs["seed"] == 2003
        assert json.loads(file["data"].attrs["ocplanner_collect"])["first_seed"] == 2000
    assert collected.failures == 2
    assert sum(ok for _, ok in tried) == 5


def test_a_stopped_collection_goes_on(toy, tmp_path):
    def stop(name, ok):
        if name == "demo_3":
            raise KeyboardInterrupt

    path = tmp_path / "d.hdf5"
    with pytest.raises(KeyboardInterrupt):
        collect(path, FIVE, progress=stop)
    assert not path.exists()
    assert collect(path, FIVE).failures == 2
    with h5py.File(path) as file:
        assert sorted(file["data"]) == ["demo_0", "demo_1", "demo_3", "demo_4", "demo_6"]


@pytest.mark.parametrize("flaw", ["early-release", "misjudged-goal"])
def test_records_failures(tmp_path, flaw):
    collected = collect(tmp_path / "failures.hdf5", CollectSettings(episodes=2, flaw=flaw))
    with Demonstrations(collected.path) as demos:
        assert json.loads(demos.attrs["ocplanner_collect"])["flaw"] == flaw
        peg = np.array([0.23, 0.10])
        for demo in demos:
            assert demo.rewards.max() == demo.dones.max() == 0
            positions, rotations = demo.object_poses("SquareNut")
            held = held_steps(positions, rotations, demo.eef_positions, demo.actions[:, 6])
            assert demo.actions[-1, 6] == -1
            assert np.linalg.norm(positions[-1, :2] - peg) > 0.02
            lowest, highest = (8, 55) if flaw == "early-release" else (60, 150)
            assert lowest < held.sum() < highest
            let_go = np.flatnonzero(held)[-1] + 1
            assert (positions[let_go, 2] > 0.94) == (flaw == "early-release")  # in the air, or put down


def test_gives_up_when_nothing_succeeds(toy, tmp_path, monkeypatch):
    monkeypatch.setattr(collecting, "record", lambda env, seed, **_: None)
    with pytest.raises(DatasetError, match="0 of 1000"):
        collect(tmp_path / "d.hdf5", CollectSettings(episodes=1))
