import numpy as np
import pytest
import torch

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import MismatchError
from ocplanner.policies import q_values as module
from ocplanner.policies.observation import Observation
from ocplanner.policies.policy import Policy
from ocplanner.policies.q_values import q_values
from ocplanner.policies.train import train_policy


def test_values_follow_the_episode_whatever_the_batch(tiny_square, tmp_path, monkeypatch, small):
    policy = Policy.load(train_policy(small("bcq", steps=10), tiny_square(), tmp_path / "run"))
    with Demonstrations(tiny_square()) as demos:
        whole = q_values(policy, demos, "demo_2")
        monkeypatch.setattr(module, "EVALUATION_BATCH", 7)
        np.testing.assert_allclose(q_values(policy, demos, "demo_2"), whole, rtol=1e-5)
        demo = demos["demo_2"]
        rows = np.concatenate([demo.observation(key) for key in policy.observation_keys], axis=1)
        second = policy.network.critics.members[1]
        values = second(Observation(torch.from_numpy(rows).float(), {}, None), torch.from_numpy(demo.actions).float())
    assert whole.shape == (2, 90)
    np.testing.assert_allclose(whole[1], values.detach().numpy(), rtol=1e-4, atol=1e-5)


def test_a_policy_without_critics_is_refused(tiny_square, tmp_path, small):
    policy = Policy.load(train_policy(small(steps=10), tiny_square(), tmp_path / "run"))
    with (
        Demonstrations(tiny_square()) as demos,
        pytest.raises(MismatchError, match="trained by bc, which has no critic"),
    ):
        q_values(policy, demos, "demo_2")
