import numpy as np
import pytest

from ocplanner.control.hand_over import ends_for_hands, ready_beside, rotation_to_taker
from ocplanner.control.settings import SeveralArmsSettings
from ocplanner.envs.tasks import task
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import yaw_rotation

SETTINGS = SeveralArmsSettings()


class FromTheRight:
    """An arm whose base is far along -y."""

    def outward(self, position):
        return np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(("toward", "giver", "taker"), [(1.0, "heel", "head"), (-1.0, "neck", "foot")])
def test_the_taker_gets_the_end_that_is_on_its_side(toward, giver, taker):
    spec = task("Transport").object("payload")
    lying = Pose(np.array([0.2, -0.45, 0.83]), np.array([[1.0, 0, 0], [0, 0, toward], [0, -toward, 0]]))
    held, left = ends_for_hands(spec, lying, FromTheRight(), SETTINGS)
    assert {grasp.name.split("-")[0] for grasp in held.grasps} == {giver}
    assert {grasp.name.split("-")[0] for grasp in left.grasps} == {taker}
    assert held.hover == spec.hover
    assert left.hover is None  # there are no walls where the hands meet
    assert left.lean > held.lean


def test_the_taker_waits_on_its_own_side_of_the_meeting():
    home = Pose(np.array([0.0, 0.35, 1.0]), np.eye(3))
    place = ready_beside(np.array([0.0, 0.0, 1.08]), home, SETTINGS)
    np.testing.assert_allclose(place.position, [0.0, 0.13, 1.16])
    assert ready_beside(np.array([0.0, -0.4, 1.08]), home, SETTINGS) is home  # not yet on its way
    assert ready_beside(np.array([0.0, 0.3, 1.08]), home, SETTINGS) is home  # it is there already


@pytest.mark.parametrize("toward", [1.0, -1.0])
def test_the_end_that_is_left_is_turned_to_the_taker(toward):
    spec = task("Transport").object("payload")
    flat = np.array([[1.0, 0, 0], [0, 0, toward], [0, -toward, 0]])
    lying = Pose(np.array([0.2, -0.45, 0.83]), yaw_rotation(0.5) @ flat)
    held, left = ends_for_hands(spec, lying, FromTheRight(), SETTINGS)
    turned = Pose(lying.position, rotation_to_taker(lying, held, left, np.array([0.0, 1.6, 0.0])))
    far, near = ((turned @ half.grasps[0].pose_object_eef).position for half in (left, held))
    np.testing.assert_allclose((far - near)[:2], [0.0, 0.13], atol=1e-9)
    np.testing.assert_allclose(turned.rotation[2], lying.rotation[2], atol=1e-9)  # about the vertical only
