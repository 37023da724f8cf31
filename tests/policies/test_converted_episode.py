import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch

from ocplanner.collection.collect import collect
from ocplanner.collection.settings import CollectSettings
from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import MismatchError
from ocplanner.policies.converted_episode import load_episode
from ocplanner.policies.data import load_samples
from ocplanner.policies.policy import Policy
from ocplanner.policies.train import train_policy


@pytest.fixture(scope="module")
def policy(tiny_square, tmp_path_factory, small):
    config = small("bcq", steps=5, save_every=5)
    return Policy.load(train_policy(config, tiny_square("1.4.1"), tmp_path_factory.mktemp("policy") / "run"))


def test_its_own_recordings_stay_as_they_are(policy, tiny_square):
    with Demonstrations(tiny_square("1.4.1")) as demos:
        episode, plain = load_episode(policy, demos, "demo_2"), load_samples(demos, ["demo_2"], policy.training)
    assert torch.equal(episode.low_dim, plain.low_dim)
    assert torch.equal(episode.actions, plain.actions)


def test_what_a_later_robosuite_records_is_put_in_the_policys_order(policy, tmp_path):
    """A collected episode against the poses that the simulator had."""
    path = collect(tmp_path / "d.hdf5", CollectSettings(episodes=1)).path
    with Demonstrations(path) as demos:
        demo = demos[0]
        episode = load_episode(policy, demos, demo.name)
        positions, _ = demo.object_poses("SquareNut")
        np.testing.assert_allclose(episode.low_dim[:, :3], positions, atol=1e-6)
        np.testing.assert_allclose(episode.low_dim[:, 14:17], demo.eef_positions, atol=1e-6)
        np.testing.assert_allclose(episode.actions, demo.actions, atol=1e-6)  # the Panda's base stands straight
        assert demo.object_layout() == "relative-first" != policy.header.object_layout


def test_actions_are_rescaled_and_turned(policy, tiny_square, tmp_path, monkeypatch):
    path = tmp_path / "half.hdf5"
    shutil.copy(tiny_square("1.4.1"), path)
    with h5py.File(path, "a") as file:
        args = json.loads(file["data"].attrs["env_args"])
        most = [0.1] * 3 + [0.25] * 3
        args["env_kwargs"]["controller_configs"] |= {"output_max": most, "output_min": [-value for value in most]}
        args["env_kwargs"]["controller_configs"]["input_ref_frame"] = "base"
        file["data"].attrs["env_args"] = json.dumps(args)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = "ocplanner.demos.action_frame.ActionFrame.rotations_world"
    monkeypatch.setattr(turned, lambda _, demo, rows: np.stack([quarter] * len(rows)))
    with Demonstrations(path) as demos:
        actions, found = demos["demo_2"].actions, load_episode(policy, demos, "demo_2").actions
        np.testing.assert_allclose(found[:, :2], 2 * actions[:, [1, 0]] * [-1, 1], atol=1e-6)
        np.testing.assert_allclose(found[:, 5:], actions[:, 5:] * [0.5, 1], atol=1e-6)
        based = Policy.load(policy.path)
        based.header = replace(policy.header, action_frame="base")
        np.testing.assert_allclose(load_episode(based, demos, "demo_2").actions[:, 0], 2 * actions[:, 0], atol=1e-6)
    with (
        Demonstrations(tiny_square("1.4.1")) as demos,
        pytest.raises(MismatchError, match="learned from the base frame"),
    ):
        load_episode(based, demos, "demo_2")


def test_another_task_is_refused(policy, tiny_square, tmp_path):
    based = Policy.load(policy.path)
    based.header = replace(policy.header, task="Can")
    with Demonstrations(tiny_square("1.4.1")) as demos, pytest.raises(MismatchError, match="shows Square, but"):
        load_episode(based, demos, "demo_2")
