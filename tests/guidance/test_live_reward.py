"""The live reward against the labels of the same states: a human Square demonstration, state by state."""

from typing import get_args

import gymnasium
import numpy as np
import pytest

from ocplanner.collection.render import render_dataset
from ocplanner.collection.settings import RenderSettings
from ocplanner.control.grasp_detection import GraspDetector
from ocplanner.demos.dataset import Demonstrations
from ocplanner.envs.gymnasium_env import GymnasiumEnv
from ocplanner.errors import MismatchError, UnknownNameError
from ocplanner.guidance.dataset import label_dataset
from ocplanner.guidance.live_reward import PlanReward
from ocplanner.guidance.rewards import Form, RewardConfig
from ocplanner.guidance.settings import LabelSettings
from random_planner import write_random_planner


@pytest.fixture(scope="module", params=["pose", "position"])
def planner(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("planner") / "planner.safetensors"
    write_random_planner(path, outputs=request.param)
    return path


@pytest.fixture(scope="module")
def images(square_ph, tmp_path_factory):
    path = tmp_path_factory.mktemp("images") / "images.hdf5"
    return render_dataset(square_ph, path, RenderSettings(silhouettes=()), limit=1)


@pytest.fixture(scope="module")
def env():
    with GymnasiumEnv("Square", "Panda", cameras=()) as made:
        yield made


def put_on_record(env: GymnasiumEnv, states: np.ndarray, monkeypatch) -> None:
    """The environment goes through recorded states, whatever the action."""
    rows = iter(states)
    monkeypatch.setattr(env.env, "reset", lambda _seed: env.env.set_state(next(rows)))
    monkeypatch.setattr(env.env, "step", lambda _action: env.env.set_state(next(rows)))


@pytest.mark.parametrize("form", get_args(Form))
def test_the_same_states_give_the_same_reward(images, planner, env, form, monkeypatch, tmp_path):
    # Large weights, so that a part in a million of the reward shows any error.
    config = RewardConfig(a=5.0, b=1.0, form=form, gamma=0.9, scale=3.0)
    settings = LabelSettings(hints=False, reward="augment", reward_config=config)
    with Demonstrations(label_dataset(images, tmp_path / "labelled.hdf5", planner, settings)) as demos:
        demo = demos[0]
        actions, states, labelled = demo.actions, demo.states, demo.arrays()
    put_on_record(env, states, monkeypatch)
    live = PlanReward(env, planner, config)
    live.reset(seed=0)
    held = 0
    for row in range(len(states) - 1):  # what came after the last state was not recorded
        _, reward, _, _, info = live.step(actions[row])
        where = f"step {row}"
        np.testing.assert_allclose(reward, labelled["rewards"][row], atol=1e-6, rtol=1e-6, err_msg=where)
        assert info["reward_sparse"] == labelled["rewards_sparse"][row], where
        np.testing.assert_allclose(info["ocp_reward_position"], labelled["ocp_reward_position"][row], atol=1e-6)
        assert ("ocp_reward_rotation" in info) == ("ocp_reward_rotation" in labelled)
        held += info["ocp_reward_position"] > 0
    assert held > 30


def test_only_leaves_the_tasks_own_reward_out(images, planner, env, monkeypatch):
    with Demonstrations(images) as demos:
        actions, states = demos[0].actions, demos[0].states
    rewards = {}
    for mode in ("augment", "only"):
        with monkeypatch.context() as patch:
            put_on_record(env, states, patch)
            live = PlanReward(env, planner, mode=mode)
            live.reset(seed=0)
            rewards[mode] = [live.step(action)[1] for action in actions[:-1]]
    difference = np.subtract(rewards["augment"], rewards["only"])
    np.testing.assert_allclose(difference[-3:], 1)
    np.testing.assert_allclose(difference[:-10], 0, atol=1e-12)


def test_an_episode_repeats(planner, monkeypatch):
    """The environment itself, stepped: nothing of the last episode is left after a reset."""
    monkeypatch.setattr(GraspDetector, "update", lambda self, pose, hand, last_gripper: last_gripper > 0)
    with gymnasium.make("ocplanner/Square-v0", cameras=()) as made:
        live = PlanReward(made, planner)
        close = np.array([0, 0, 0, 0, 0, 0, 1], np.float32)
        episodes = []
        for _ in range(2):
            live.reset(seed=1)
            episodes.append([live.step(close)[1] for _ in range(3)])
    assert episodes[0] == episodes[1]
    assert episodes[0][0] == 0  # the hand had not begun to close
    assert episodes[0][2] < 0


def test_what_does_not_fit_is_refused(planner, env):
    with pytest.raises(UnknownNameError, match="unknown reward mode 'off'; known: augment, only"):
        PlanReward(env, planner, mode="off")  # type: ignore[arg-type]
    with pytest.raises(MismatchError, match="no environment of ocplanner"):
        PlanReward(gymnasium.make("CartPole-v1"), planner)  # type: ignore[arg-type]
    with GymnasiumEnv("Lift", cameras=()) as lift, pytest.raises(MismatchError, match="plans for Square"):
        PlanReward(lift, planner)


def test_each_arms_hand_goes_with_its_own_gripper(tmp_path, monkeypatch):
    """The hammer is in the second arm's hand, whose gripper is closed; the first arm's is open and far away."""
    path = tmp_path / "p.safetensors"
    write_random_planner(path, task="Transport", object="payload:1")
    seen = []

    def update(self, pose, hand, last_gripper):
        seen.append((pose, hand, last_gripper))
        return last_gripper > 0

    monkeypatch.setattr(GraspDetector, "update", update)
    action = np.zeros(14)
    action[6], action[13] = -1.0, 1.0
    with GymnasiumEnv("Transport", cameras=()) as env:
        live = PlanReward(env, path)
        live.reset(seed=0)
        rewards = [live.step(action)[4]["ocp_reward_position"] for _ in range(2)]
        hand, hammer = env.env.arms[1].eef_pose().position, env.env.object_pose("payload")
    assert rewards[0] == 0  # the hand had not begun to close
    assert rewards[1] > 0
    pose, where, gripper = seen[-1]
    assert gripper == 1.0
    np.testing.assert_array_equal(where, hand)
    np.testing.assert_array_equal(pose.position, hammer.position)


def test_an_object_may_be_in_either_hand(tmp_path, monkeypatch):
    path = tmp_path / "p.safetensors"
    write_random_planner(path, task="Transport", object="payload")
    monkeypatch.setattr(GraspDetector, "update", lambda self, pose, hand, last_gripper: last_gripper > 0)
    closing = np.zeros((3, 14))
    closing[:, [6, 13]] = [[1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]]
    with GymnasiumEnv("Transport", cameras=()) as env:
        live = PlanReward(env, path)
        live.reset(seed=0)
        held = [live.step(action)[4]["ocp_reward_position"] > 0 for action in (*closing, np.zeros(14))]
    assert held == [False, True, True, False]
