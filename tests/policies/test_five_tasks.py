"""Policies of every task that the scripted experts solve train and evaluate, from states and from pictures."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from ocplanner.collection.collect import collect
from ocplanner.collection.render import render_dataset
from ocplanner.collection.settings import CollectSettings, RenderSettings
from ocplanner.demos.object_sensors import OBJECT_SENSORS, rearranged
from ocplanner.files.records.evaluation import EvaluationSettings
from ocplanner.policies.config import PROPRIOCEPTION
from ocplanner.policies.evaluate import evaluate_policy
from ocplanner.policies.policy import Policy
from ocplanner.policies.train import train_policy

TASKS = ("Lift", "Stack", "Can", "Square", "ToolHang")
PIXELS = 24


@pytest.fixture(scope="module", params=TASKS)
def recorded(request, tmp_path_factory):
    """Two scripted demonstrations of a task."""
    path = tmp_path_factory.mktemp("tasks") / f"{request.param}.hdf5"
    return request.param, collect(path, CollectSettings(request.param, episodes=2, noise=0.5)).path


def evaluated(run, **options):
    settings = EvaluationSettings(episodes=1, horizon=4)
    return evaluate_policy(run / "policy.safetensors", settings=settings, **options)


def test_from_states(recorded, tmp_path, small):
    task, path = recorded
    train_policy(small(steps=5, save_every=5), path, tmp_path / "run")
    header = Policy.load(tmp_path / "run").header
    assert (header.object_layout, header.task) == ("relative-first", task)
    assert header.object_sensors == OBJECT_SENSORS[header.environment]["relative-first"]
    result = evaluated(tmp_path / "run")
    assert (result.task, result.checkpoints[0].runs[0].steps) == (task, 4)


def test_from_pictures(recorded, tmp_path, small):
    task, path = recorded
    drawn = render_dataset(path, tmp_path / "images.hdf5", RenderSettings("full", size=PIXELS), limit=1)
    config = small(steps=5, save_every=5, cameras=("agentview",))
    seen = replace(config.observation, low_dim=PROPRIOCEPTION, image_size=PIXELS, crop=20)
    train_policy(replace(config, observation=seen, mask=None), drawn, tmp_path / "run")
    result = evaluated(tmp_path / "run")
    assert (result.task, result.privileged, result.checkpoints[0].runs[0].steps) == (task, (), 4)


def test_what_robosuite_1_4_recorded_is_learned_in_its_own_order(recorded, tmp_path, small):
    """The same demonstrations as that version would have written them: told by the numbers, whoever says what."""
    _, path = recorded
    old = tmp_path / "old.hdf5"
    old.write_bytes(path.read_bytes())
    with h5py.File(old, "a") as file:
        args = file["data"].attrs["env_args"]
        file["data"].attrs["env_args"] = args.replace('"env_version": "1.5', '"env_version": "1.4')
        env_name = next(name for name in OBJECT_SENSORS if f'"{name}"' in args)
        orders = OBJECT_SENSORS[env_name]
        for demo in file["data"].values():
            seen = demo["obs/object"][:]
            demo["obs/object"][:] = rearranged(seen, orders["relative-first"], orders["absolute-first"])
            back = rearranged(demo["obs/object"][:], orders["absolute-first"], orders["relative-first"])
            np.testing.assert_array_equal(back, seen)
    train_policy(small(steps=1), old, tmp_path / "run")
    header = Policy.load(tmp_path / "run").header
    assert (header.object_layout, header.object_sensors) == ("absolute-first", orders["absolute-first"])
    evaluated(tmp_path / "run")
