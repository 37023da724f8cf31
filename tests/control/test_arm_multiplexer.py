import numpy as np
import pytest

from ocplanner import _core
from ocplanner.control.arm import CLOSE, OPEN
from ocplanner.control.arm_multiplexer import ArmMultiplexer
from ocplanner.envs.environment import make_env
from ocplanner.geometry.pose import Pose


@pytest.fixture(scope="module")
def env():
    with make_env("Transport", cameras=()) as made:
        yield made


def _hands(env):
    env.reset(500)
    actions = []
    law = _core.DeltaPoseLaw(gain_position=1.5, gain_rotation=1.5)
    return ArmMultiplexer(env, law, "lid", actions.append), actions


def test_one_arm_moves_and_the_other_stays(env):
    hands, actions = _hands(env)
    starts = [arm.eef_pose().position for arm in env.arms]
    hands.activate("trash", 1)
    for _ in range(20):
        hands.step(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, CLOSE]))
    ends = [arm.eef_pose().position for arm in env.arms]
    assert np.linalg.norm(ends[0] - starts[0]) < 0.003
    assert ends[1][2] - starts[1][2] > 0.05
    assert [action.shape for action in actions] == [(14,)] * 20
    assert (actions[-1][6], actions[-1][13]) == (OPEN, CLOSE)
    np.testing.assert_array_equal(hands.eef_pose().position, ends[1])
    np.testing.assert_array_equal(hands.object_pose().position, env.object_pose("trash").position)
    hands.activate("lid", 0)
    for _ in range(20):
        hands.step(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, OPEN]))
    assert np.linalg.norm(env.arms[1].eef_pose().position - ends[1]) < 0.01
    assert actions[-1][13] == CLOSE  # a waiting hand keeps what it holds


def test_a_waiting_arm_goes_where_it_is_to_wait(env):
    hands, _ = _hands(env)
    start = env.arms[1].eef_pose()
    place = Pose(start.position + np.array([0.0, 0.0, 0.1]), start.rotation)
    hands.wait_at(place, 1)
    for _ in range(40):
        hands.step(np.zeros(7))
    assert np.linalg.norm(env.arms[1].eef_pose().position - place.position) < 0.005


def test_a_hand_that_rises_first_goes_over_a_wall(env):
    hands, _ = _hands(env)
    start = env.arms[1].eef_pose()
    hands.wait_at(Pose(start.position + np.array([-0.1, 0.0, 0.1]), start.rotation), 1, rising=True)
    way = []
    for _ in range(60):
        hands.step(np.zeros(7))
        way.append(env.arms[1].eef_pose().position - start.position)
    low = np.array([place for place in way if place[2] < 0.05])
    assert len(low) > 2
    assert np.abs(low[:, 0]).max() < 0.02
    assert way[-1][0] < -0.09


def test_a_waiting_hand_opens_when_it_is_told_to(env):
    hands, actions = _hands(env)
    hands.activate("trash", 1)
    hands.step(np.append(np.zeros(6), CLOSE))
    hands.activate("trash", 0)
    hands.open(1)
    hands.step(np.append(np.zeros(6), CLOSE))
    assert [action[13] for action in actions] == [CLOSE, OPEN]
