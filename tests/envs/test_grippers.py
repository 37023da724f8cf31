import numpy as np
import pytest

from ocplanner.envs import make_env
from ocplanner.envs.simulator import mujoco
from ocplanner.geometry.pose import Pose


def test_jacos_finger_meets_the_thumb_along_the_turned_line(shared_env):
    env = shared_env("Square", "Jaco")
    env.reset(0)
    env.place_eef(env.eef_pose(), 0.032, restarts=0)
    (finger,), (thumb,) = env.arms[0].gripper.pads
    site = env.robot.rotation_grasp_site @ env.eef_pose().rotation.T
    for pad in (finger, thumb):
        out_of_pad = site @ env.data.geom_xmat[pad].reshape(3, 3)[:, 1]
        assert abs(np.arctan(out_of_pad[1] / out_of_pad[0])) < 0.04
    middle = (env.data.geom_xpos[finger] + env.data.geom_xpos[thumb]) / 2
    in_site = env.eef_pose().rotation.T @ (middle - env.eef_pose().position)
    np.testing.assert_allclose(in_site[:2], env.robot.middle[:2], atol=3e-3)


def test_a_distance_that_mujoco_takes_for_zero_is_asked_for_again(shared_env, monkeypatch):
    env = shared_env("Square", "Jaco")
    env.reset(0)
    gripper = env.arms[0].gripper
    opening, places = gripper.opening, env.data.geom_xpos.copy()
    found = mujoco.mj_geomDistance
    (finger,) = gripper.pads[0]

    def distance(model, data, *pair):
        return 0.0 if np.array_equal(data.geom_xpos[finger], places[finger]) else found(model, data, *pair)

    monkeypatch.setattr(mujoco, "mj_geomDistance", distance)
    assert gripper.opening == pytest.approx(opening, abs=1e-5)
    np.testing.assert_array_equal(env.data.geom_xpos, places)
    monkeypatch.setattr(mujoco, "mj_geomDistance", lambda *_: 0.0)
    assert gripper.opening == 0.0


@pytest.mark.parametrize("robot", ["IIWA", "Jaco"])
def test_the_stroke_does_not_depend_on_where_the_hand_is_first_seen(robot):
    found = []
    for height in (0.0, 0.2):
        with make_env("Lift", robot, cameras=()) as env:
            cube = env.object_pose()
            env.place_eef(Pose(cube.position + np.array([0, 0, height]), env.eef_pose().rotation), restarts=0)
            gaps = []
            for opening in (0.0, 0.03, 1.0):
                env.arms[0].gripper.set_opening(opening)
                mujoco.mj_kinematics(env.model, env.data)
                gaps.append(env.gripper_opening)
            found.append(gaps)
    np.testing.assert_allclose(found[0], found[1], atol=2e-6)  # a doubtful zero is asked for again a micrometre aside
    assert found[0][0] < 0.005
    assert found[0][1] == pytest.approx(0.03, abs=0.006)
    assert found[0][2] > 0.1
