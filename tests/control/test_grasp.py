from dataclasses import replace

import numpy as np
import pytest

from ocplanner.control.arm import OPEN, STAY, Reading
from ocplanner.control.grasp import choose_grasp, leaning, opening_before, toward
from ocplanner.control.settings import GraspSettings
from ocplanner.envs.robots import robot
from ocplanner.envs.tasks import task
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

NUT = task("Square").object()
GRASP = GraspSettings()


class Wrist:
    """A robot at the world's origin whose wrist has room for turns to one side only."""

    def __init__(self, forbidden: np.ndarray | None) -> None:
        self.forbidden = forbidden
        self.turns: list[float] = []

    def outward(self, position: np.ndarray) -> np.ndarray:
        return np.array([1.0, 0.0, 0.0])

    def reach_error(self, pose: Pose) -> float:
        return 0.0

    def wrist_room(self, pose: Pose, turn: float) -> float:
        self.turns.append(turn)
        if self.forbidden is not None and angle_between(pose.rotation, self.forbidden) < 0.1:
            return -0.5
        return 0.5


@pytest.mark.parametrize("grasp", NUT.grasps, ids=lambda grasp: grasp.name)
def test_a_leaning_hand_keeps_its_fingers_and_moves_its_palm_outward(grasp):
    upright, leaned = grasp.pose_object_eef, leaning(grasp.pose_object_eef, 0.3)
    np.testing.assert_allclose(leaned.rotation @ leaned.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(leaned.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(leaned.rotation[:, 0], upright.rotation[:, 0])
    np.testing.assert_array_equal(leaned.position, upright.position)
    palm = leaned.position - 0.2 * leaned.rotation[:, 2]
    assert palm[0] - leaned.position[0] == pytest.approx(0.2 * np.sin(0.3))


@pytest.mark.parametrize("grasp", task("Can").object().grasps, ids=lambda grasp: grasp.name)
def test_a_hand_at_the_middle_leans_toward_the_robot(grasp):
    inward = np.array([-np.cos(0.3), np.sin(0.3), 0.0])
    leaned = leaning(grasp.pose_object_eef, 0.3, inward)
    sideways = np.abs(grasp.pose_object_eef.rotation[:, 1] @ inward)
    assert -leaned.rotation[:, 2] @ inward == pytest.approx(np.sin(0.3) * sideways)
    assert leaning(grasp.pose_object_eef, 0.3) is grasp.pose_object_eef


def test_the_grasp_that_turns_the_wrist_least_unless_it_would_reach_its_limit():
    first, second = (grasp.pose_object_eef for grasp in NUT.grasps)
    nut = Pose(np.array([0.4, 0.1, 0.83]), np.eye(3))
    now = Reading(nut, Pose(np.zeros(3), second.rotation), 0.08)
    assert angle_between(choose_grasp(NUT, robot("Panda"), now, GRASP).rotation, second.rotation) < 1e-6
    free = Wrist(None)
    assert angle_between(choose_grasp(NUT, robot("IIWA"), now, GRASP, free).rotation, second.rotation) < 1e-6
    assert abs(free.turns[0]) == pytest.approx(np.pi)  # the handle points away from the robot
    chosen = choose_grasp(NUT, robot("IIWA"), now, GRASP, Wrist(second.rotation))
    assert angle_between(chosen.rotation, first.rotation) < 1e-6


@pytest.mark.parametrize("turn", [0.0, np.pi])
def test_a_spare_finger_points_away_from_an_object_that_is_held_beside_its_middle(turn):
    jaco = robot("Jaco")
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    first = NUT.grasps[0].pose_object_eef
    now = Reading(Pose(np.array([0.4, 0.1, 0.83]), np.eye(3)), Pose(np.zeros(3), rotation @ first.rotation), 0.08)
    chosen = choose_grasp(NUT, jaco, now, GRASP, Wrist(None))
    spare = chosen.position - 0.02 * chosen.rotation[:, 1]
    assert spare[0] > first.position[0] + 0.03  # beyond the handle's end
    held = chosen.position + chosen.rotation @ jaco.middle
    np.testing.assert_allclose(held, first.position, atol=1e-12)
    assert chosen.rotation[2, 2] == pytest.approx(-1.0)  # upright


def test_where_a_spare_finger_has_no_room_at_all_a_grasp_is_chosen_all_the_same():
    inner = replace(robot("Jaco"), middle=(0.0, 0.013, 0.0))
    one_sided = replace(NUT, grasps=(NUT.grasps[0],))
    other = replace(NUT, grasps=(NUT.grasps[1],))
    now = Reading(Pose(np.zeros(3), np.eye(3)), Pose(np.zeros(3), np.eye(3)), 0.08)
    assert {choose_grasp(spec, inner, now, GRASP).position.size for spec in (one_sided, other)} == {3}


def test_a_slow_gripper_opens_as_far_as_the_object_needs_and_others_fully():
    jaco, can = robot("Jaco"), task("Can").object()
    assert opening_before(can, jaco) == pytest.approx(0.05 + jaco.spread)
    assert opening_before(can, robot("Panda")) == np.inf
    unknown = replace(can, grasps=tuple(replace(grasp, width=None) for grasp in can.grasps))
    assert opening_before(unknown, jaco) == np.inf
    assert toward(0.07, 0.06) == OPEN
    assert toward(0.07, 0.071) == STAY
