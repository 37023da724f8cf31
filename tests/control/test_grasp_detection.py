import numpy as np
import pytest

from ocplanner.control.grasp_detection import GraspDetector, held_steps
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import manipulation_segment
from ocplanner.errors import ShapeError
from ocplanner.geometry.pose import Pose

OPEN, CLOSED = -1.0, 1.0
STEPS, GRASP, ONSET, RELEASE = 100, 30, 35, 80
HELD = range(ONSET + 1, RELEASE + 1)  # seen one step after the motion begins; the action of RELEASE opens


def carry() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    positions = np.zeros((STEPS, 3))
    positions[:, 0] = 0.01 * np.clip(np.arange(STEPS) - ONSET, 0, RELEASE - ONSET)
    gripper = np.where((np.arange(STEPS) >= GRASP) & (np.arange(STEPS) < RELEASE), CLOSED, OPEN)
    return positions, np.tile(np.eye(3), (STEPS, 1, 1)), positions + np.array([0.0, 0.05, 0.0]), gripper


def test_from_the_first_motion_to_the_release():
    assert np.flatnonzero(held_steps(*carry())).tolist() == list(HELD)


def test_not_after_the_gripper_opened_until_it_carries_again():
    positions, rotations, hands, gripper = carry()
    gripper[50:55] = OPEN
    expected = [step for step in HELD if not 51 <= step <= 56]
    assert np.flatnonzero(held_steps(positions, rotations, hands, gripper)).tolist() == expected


def test_a_command_of_zero_keeps_the_grip():
    positions, rotations, hands, gripper = carry()
    gripper[GRASP + 1 : RELEASE] = 0.0
    assert np.flatnonzero(held_steps(positions, rotations, hands, gripper)).tolist() == list(HELD)


def test_nothing_is_held_where_nothing_is_carried():
    positions, rotations, hands, gripper = carry()
    assert not held_steps(0 * positions, rotations, hands, gripper).any()
    assert not held_steps(positions, rotations, hands, np.full(STEPS, OPEN)).any()


def test_an_object_that_the_hand_leaves_behind_is_not_held():
    positions, rotations, hands, gripper = carry()
    positions[60:] = positions[60]
    held = held_steps(positions, rotations, hands, gripper)
    assert held[:63].tolist() == [step in HELD for step in range(63)]
    assert not held[65:].any()


def test_an_object_that_closing_fingers_push_is_not_held():
    positions, rotations, hands, gripper = carry()
    pushed = np.array([0.0, 0.0, 1.0]) * 0.004 * np.clip(np.arange(STEPS) - GRASP, 0, 5)[:, None]
    assert not held_steps(pushed, rotations, np.tile(hands[0], (STEPS, 1)), gripper).any()
    held = held_steps(positions + pushed, rotations, hands + pushed[-1], gripper)
    assert np.flatnonzero(held).tolist() == list(HELD)


def test_an_object_that_slides_in_the_hand_is_not_held():
    positions, rotations, hands, gripper = carry()
    assert not held_steps(0.8 * positions, rotations, hands, gripper).any()


def test_what_comes_later_changes_nothing():
    whole = held_steps(*carry())
    for stop in (40, 60, 90):
        np.testing.assert_array_equal(held_steps(*(array[:stop] for array in carry())), whole[:stop])


def test_every_step_needs_every_array():
    positions, rotations, hands, gripper = carry()
    with pytest.raises(ShapeError, match="one a step"):
        held_steps(positions, rotations, hands[1:], gripper)


def test_live_as_recorded(square_ph):
    with Demonstrations(square_ph) as demos:
        demo = demos[0]
        (positions, rotations), hands, actions = demo.object_poses("SquareNut"), demo.eef_positions, demo.actions
    hold, last, live = GraspDetector(), -1.0, []
    for step in range(demo.length):
        live.append(hold.update(Pose(positions[step], rotations[step]), hands[step], last))
        last = actions[step, -1]
    np.testing.assert_array_equal(live, held_steps(positions, rotations, hands, actions[:, -1]))


def test_holds_between_grasp_and_release_of_every_recording(square_ph):
    with Demonstrations(square_ph) as demos:
        for demo in demos:
            positions, rotations = demo.object_poses("SquareNut")
            held = held_steps(positions, rotations, demo.eef_positions, demo.actions[:, -1])
            segment = manipulation_segment(positions, rotations, demo.actions[:, -1])
            steps = np.flatnonzero(held)
            assert -7 < steps[0] - segment.onset < 26, demo.name
            assert steps[-1] == segment.release, demo.name
            assert held[steps[0] : steps[-1]].all(), demo.name
