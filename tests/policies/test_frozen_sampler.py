"""Critics above a policy that BC trained."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import InvalidValueError, MismatchError
from ocplanner.policies.frozen_sampler import frozen_sampler_training
from ocplanner.policies.policy import Policy
from ocplanner.policies.q_values import q_values
from ocplanner.policies.train import train_policy
from ocplanner.training.run_folder import RunFolder


def short(policy: Policy, **changes):
    """Its settings, with critics that learn in a second."""
    config = frozen_sampler_training(policy)
    bcq = replace(
        config.algorithm_settings, critic_hidden=(16, 16), critic_learning_rate=3e-3, proposals=4, rollout_proposals=8
    )
    numbers = {"steps": 20, "batch": 16, "save_every": 10, "validate_every": 10, "checkpoint_every": 5}
    return replace(config, algorithm_settings=bcq, **(numbers | changes))


def test_critics_choose_among_the_actions_of_a_policy_that_stays_as_it_is(rewarded, tmp_path, small):
    below = train_policy(
        small(steps=600, validate_every=600, save_every=600, learning_rate=5e-3), rewarded, tmp_path / "bc"
    )
    with Demonstrations(rewarded) as demos:
        seen = {key: demos["demo_2"].observation(key) for key in Policy.load(below).observation_keys}
    assert 0.2 < (Policy.load(below).act(seen)[:, 0] > 0).mean() < 0.8  # it has learned both
    config = short(Policy.load(below), steps=400, validate_every=100, save_every=400)
    path = train_policy(config, rewarded, tmp_path / "run", sampler=below)
    kept, before = load_file(path), load_file(below)
    for name, tensor in before.items():
        torch.testing.assert_close(kept[f"sampler.actor.{name}"], tensor, rtol=0, atol=0)
    rows = RunFolder(tmp_path / "run").rows()
    assert rows[-1].values["valid_critic_loss"] < 0.5 * rows[0].values["valid_critic_loss"]
    assert "vae_reconstruction" not in rows[-1].values
    policy = Policy.load(path)
    assert policy.training.algorithm_settings.sampler_sha256 == Policy.load(below).sha256
    with Demonstrations(rewarded) as demos:
        right = demos["demo_2"].rewards == 1
        values = q_values(policy, demos, "demo_2")
    assert values[:, right].min() > values[:, ~right].max()
    assert (policy.act(seen)[:, 0] > 0.4).mean() > 0.9


@pytest.mark.parametrize("images", [False, True])
def test_a_killed_training_continues_to_the_same_weights(tiny_square, tmp_path, killed, small, images):
    data = tiny_square(images=images)
    below = train_policy(small(cameras=("agentview",) if images else ()), data, tmp_path / "bc")
    config = short(Policy.load(below))
    whole = load_file(train_policy(config, data, tmp_path / "whole", sampler=below))
    with killed("transition_batch", 13):
        train_policy(config, data, tmp_path / "killed", sampler=below)
    resumed = load_file(train_policy(config, data, tmp_path / "killed", sampler=below))
    assert {name for name in whole if not torch.equal(whole[name], resumed[name])} == set()


def test_the_critics_read_what_the_policy_makes_of_the_pictures(tiny_square, tmp_path, small):
    data = tiny_square(images=True)
    below = train_policy(small(cameras=("agentview",)), data, tmp_path / "bc")
    run = train_policy(short(Policy.load(below)), data, tmp_path / "run", sampler=below)
    policy, actor = Policy.load(run), Policy.load(below).network
    with Demonstrations(data) as demos:
        demo = demos["demo_2"]
        values = q_values(policy, demos, "demo_2")
        low_dim = {key: demo.observation(key) for key in policy.training.observation.low_dim}
        seen = policy._tensors(low_dim | {"agentview_image": demo.images("agentview")})
        actions = torch.from_numpy(demo.actions.astype(np.float32))
    with torch.no_grad():
        features = actor.encode(seen)
        for critic, expected in zip(policy.network.critics.members, values, strict=True):
            standard = (features - critic.seen.mean) / critic.seen.std
            found = critic.value(critic.layers(torch.cat([standard, actions], dim=-1)))[:, 0]
            np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_only_a_policy_of_bc_without_a_hint_proposes(tiny_square, tmp_path, small):
    recurrent = Policy.load(train_policy(small("bc-rnn"), tiny_square(), tmp_path / "rnn"))
    with pytest.raises(MismatchError, match="was trained by bc-rnn; critics need one that bc trained"):
        frozen_sampler_training(recurrent)
    data = tmp_path / "hints.hdf5"
    shutil.copy(tiny_square(), data)
    with h5py.File(data, "a") as file:
        for demo in file["data"].values():
            demo["obs/ocp_hint"] = np.zeros((len(demo["actions"]), 7), dtype=np.float32)
    with pytest.raises(MismatchError, match="reads hints"):
        frozen_sampler_training(Policy.load(train_policy(small(hint=(1,)), data, tmp_path / "hinted")))


def test_policy_and_data_must_belong_together(tiny_square, tmp_path, small):
    below = train_policy(small(), tiny_square(), tmp_path / "bc")
    other = train_policy(small(seed=1), tiny_square(), tmp_path / "other")
    config = short(Policy.load(below))
    with pytest.raises(MismatchError, match=r"is to propose; give that policy"):
        train_policy(config, tiny_square(), tmp_path / "run", sampler=other)
    with pytest.raises(InvalidValueError, match="proposes: give its file as sampler"):
        train_policy(config, tiny_square(), tmp_path / "run")
    with pytest.raises(MismatchError, match="its action_frame is 'base'"):
        train_policy(config, tiny_square("1.5.1"), tmp_path / "run", sampler=below)
    assert not (tmp_path / "run").exists()
