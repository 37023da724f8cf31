import numpy as np
import pytest

from ocplanner.envs.patches import PATCHES
from ocplanner.envs.robots import ROBOTS, robot
from ocplanner.errors import UnknownNameError


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_grasp_frames_x_is_the_closing_axis(name: str):
    spec = robot(name)
    rotation = spec.rotation_grasp_site
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    closing_in_site = np.eye(3)["xy".index(spec.closing_axis)]
    np.testing.assert_allclose(rotation @ closing_in_site, [np.cos(spec.turn), np.sin(spec.turn), 0])
    np.testing.assert_allclose(rotation @ [0, 0, 1], [0, 0, 1], atol=1e-15)
    assert set(spec.patches) <= set(PATCHES)


def test_an_unknown_robot_lists_the_known():
    with pytest.raises(UnknownNameError, match="Panda, Sawyer"):
        robot("PR2")


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_what_only_a_gripper_with_a_spare_finger_has_is_said_whole(name: str):
    spec = robot(name)
    assert (spec.spare_finger is None) == (spec.middle == (0.0, 0.0, 0.0))
    assert (spec.holding == 1.0) == (spec.squeeze_steps == 0)
