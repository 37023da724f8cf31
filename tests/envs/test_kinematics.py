import numpy as np
import pytest

from ocplanner.envs.kinematics import ArmJoints, Reach
from ocplanner.geometry.pose import Pose

DOWN = np.diag([1.0, -1.0, -1.0])
FAR, NEAR = np.array([0.23, 0.16, 0.98]), np.array([0.0, 0.1, 0.98])


@pytest.fixture
def kinova(shared_env):
    env = shared_env("Square", "Kinova3")
    env.reset(0)
    return env, Reach(env.model, env.data, ArmJoints.of(env.robosuite_env.robots[0], env.model))


def test_foretells_reach_without_moving_the_arm(kinova):
    env, reach = kinova
    before = env.data.qpos.copy()
    assert reach.reach_error(Pose(NEAR, env.eef_pose().rotation)) < 0.002
    assert reach.reach_error(Pose(FAR, env.eef_pose().rotation)) > 0.05
    np.testing.assert_array_equal(env.data.qpos, before)


def test_outward_is_away_from_the_arm_and_horizontal(kinova):
    _, reach = kinova
    outward = reach.outward(FAR)
    assert np.linalg.norm(outward) == pytest.approx(1.0)
    assert outward[2] == 0.0
    assert outward[0] > 0.9


def test_the_wrists_room_shrinks_with_the_turn_on_either_side(shared_env):
    env = shared_env("Square", "IIWA")
    env.reset(0)
    reach = Reach(env.model, env.data, ArmJoints.of(env.robosuite_env.robots[0], env.model))
    here = env.eef_pose()
    straight = reach.wrist_room(here, 0.0)
    assert straight == pytest.approx(3.0, abs=0.2)
    assert reach.wrist_room(here, 1.0) == pytest.approx(reach.wrist_room(here, -1.0), abs=0.4)
    assert reach.wrist_room(here, 3.2) < 0 > reach.wrist_room(here, -3.2)
