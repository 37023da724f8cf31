import numpy as np
import pytest

from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.envs import make_env
from ocplanner.errors import MismatchError
from ocplanner.files.records.labels import ActionScale
from ocplanner.policies.network import make_network
from ocplanner.policies.policy import Policy, save_policy
from ocplanner.policies.rollout import PolicyRollout
from random_policy import header_of


@pytest.fixture
def policy(tmp_path, small):
    """``policy(**changes)``: an untrained policy."""

    def make(algorithm="bc", hint=None, **changes):
        config = small(algorithm, hint)
        path = tmp_path / "policy.safetensors"
        save_policy(make_network(config, 23, 7), header_of(config, **changes), path)
        return Policy.load(path)

    return make


class Says:
    """In place of a policy's draw: always the same action."""

    def __init__(self, policy, action):
        self._policy, self._action = policy, np.array([action], np.float32)

    def __getattr__(self, name):
        return getattr(self._policy, name)

    def act(self, observation):
        return self._action


@pytest.mark.parametrize("robot", ["Panda", "Sawyer"])
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_recorded_frame_and_scale_are_kept_on_any_arm(policy, robot, scale):
    scales = ActionScale(0.05 * scale, 0.5 * scale)
    along = []
    with make_env("Square", robot, cameras=()) as env:
        rollout = PolicyRollout(env, Says(policy(action_scale=scales), [0, 0.5, 0, 0, 0, 0, -1]))
        for horizon in (5, 15):
            assert rollout.play(20000, horizon) == (False, horizon, "missed grasp")
            along.append(env.eef_pose().position)
    moved = along[1] - along[0]
    assert moved[1] > 0.02 * scale
    assert np.abs(moved[[0, 2]]).max() < 0.4 * moved[1]


def test_an_episode_ends_where_the_task_is_solved(policy, monkeypatch):
    with make_env("Square", "Panda", cameras=()) as env:
        monkeypatch.setattr(type(env), "success", lambda self: self.steps == 7)
        assert PolicyRollout(env, policy()).play(20000) == (True, 7, None)


@pytest.mark.parametrize(("until", "failure"), [(0, "missed grasp"), (5, "lost grasp"), (10, "time-out")])
def test_a_failure_is_told_by_when_the_object_was_held(policy, monkeypatch, until, failure):
    monkeypatch.setattr(GraspDetector, "update", lambda self, *_: env.steps < until)
    with make_env("Square", "Panda", cameras=()) as env:
        assert PolicyRollout(env, policy()).play(20000, 10) == (False, 10, failure)


def test_episodes_repeat(policy):
    with make_env("Square", "Panda", cameras=()) as env:
        rollout, ends = PolicyRollout(env, policy("bc-rnn")), []
        for seed in (20000, 20000, 20001):
            rollout.play(seed, 12)
            ends.append(env.eef_pose().position)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])


def test_refuses_what_cannot_be_carried_out(policy):
    with make_env("Square", "Panda", cameras=()) as env:
        with pytest.raises(MismatchError, match="no OSC_POSE deltas"):
            PolicyRollout(env, policy(action_frame=None, action_scale=None))
        with pytest.raises(MismatchError, match="reads hints"):
            PolicyRollout(env, policy(hint=(1,)))
        with pytest.raises(MismatchError, match="object, which cannot be had live"):
            PolicyRollout(env, policy(object_layout=None))
