"""From grasp to release: on drawn trajectories, and on the recordings that people made."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import SegmentRule, manipulation_segment
from ocplanner.errors import DatasetError, InvalidValueError, ShapeError

OPEN, CLOSED = -1.0, 1.0


def _still(steps: int) -> np.ndarray:
    return np.broadcast_to(np.eye(3), (steps, 3, 3))


def _carry(steps: int = 100, grasp: int = 30, onset: int = 35, release: int = 80) -> tuple[np.ndarray, np.ndarray]:
    """Positions and gripper actions: rest, a carry of 1 cm a step from the onset on, a fall after the release."""
    positions = np.zeros((steps, 3))
    positions[:, 0] = 0.01 * np.clip(np.arange(steps) - onset, 0, release - onset)
    positions[:, 2] = np.where(np.arange(steps) > onset, 0.1, 0.0)
    positions[release + 2 :, 2] = 0.0
    gripper = np.where((np.arange(steps) >= grasp) & (np.arange(steps) < release), CLOSED, OPEN)
    return positions, gripper


def test_from_onset_to_release():
    positions, gripper = _carry()
    assert manipulation_segment(positions, _still(100), gripper) == (31, 86, 35, 80)


def test_a_hand_that_holds_still_for_another_has_ended_its_part():
    positions, gripper = _carry()
    positions[60:] = positions[60]
    segment = manipulation_segment(positions, _still(100), gripper, SegmentRule(at_rest=True))
    assert segment == (31, 65, 35, 59)
    assert manipulation_segment(positions, _still(100), gripper).release == 80


def test_without_gripper_actions_the_motion_decides():
    positions, _ = _carry()
    segment = manipulation_segment(positions, _still(100), None)
    assert (segment.start, segment.onset) == (31, 35)
    assert segment.release == 79  # the last of the sustained motion


def test_settling_at_the_start_is_ignored():
    positions, gripper = _carry()
    positions[:6, 2] = [0.06, 0.05, 0.02, 0.01, 0.008, 0.004]
    assert manipulation_segment(positions, _still(100), gripper).onset == 35
    assert manipulation_segment(positions, _still(100), None).onset == 35


def test_a_grasp_right_after_the_settling_keeps_no_settling_frames():
    positions, gripper = _carry(grasp=4, onset=8)
    positions[:6, 2] = [0.06, 0.05, 0.02, 0.01, 0.008, 0.004]
    segment = manipulation_segment(positions, _still(100), gripper)
    assert (segment.start, segment.onset) == (6, 8)


def test_bumps_and_missed_grasps_before_are_left_out():
    positions, gripper = _carry()
    positions[15:, 0] += 0.003 * np.clip(np.arange(85), 0, 4)  # pushed 12 mm while the gripper is open
    gripper[22:26] = CLOSED  # and a grasp that misses
    assert manipulation_segment(positions, _still(100), gripper).onset == 35


def test_a_second_grasp_continues_the_manipulation():
    positions, gripper = _carry()
    gripper[50:55] = OPEN
    assert manipulation_segment(positions, _still(100), gripper) == (31, 86, 35, 80)


def test_closing_again_after_the_release_is_left_out():
    positions, gripper = _carry()
    gripper[81:] = CLOSED  # the object falls meanwhile: no carry
    assert manipulation_segment(positions, _still(100), gripper).release == 80


def test_never_opened():
    positions, gripper = _carry()
    gripper[30:] = CLOSED
    positions[:, 2] = np.where(np.arange(100) > 35, 0.1, 0.0)
    segment = manipulation_segment(positions, _still(100), gripper)
    assert (segment.release, segment.stop) == (79, 85)


def test_turning_in_place_counts_as_motion():
    angle = 0.05 * np.clip(np.arange(100) - 40, 0, 20)
    rotations = np.zeros((100, 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(angle)
    rotations[:, 1, 0], rotations[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rotations[:, 2, 2] = 1
    segment = manipulation_segment(np.zeros((100, 3)), rotations, None)
    assert (segment.onset, segment.release) == (40, 59)


def test_zero_keeps_the_gripper_as_it_is():
    positions, gripper = _carry()
    gripper[40:60] = 0
    assert manipulation_segment(positions, _still(100), gripper).release == 80


@given(
    grasp=st.integers(8, 40),
    reach=st.integers(0, 10),
    carry=st.integers(5, 60),
    shift=st.tuples(*[st.floats(-2, 2)] * 3),
    yaw=st.floats(-3, 3),
)
def test_the_frame_of_the_world_does_not_matter(grasp, reach, carry, shift, yaw):
    onset, release = grasp + reach, grasp + reach + carry
    positions, gripper = _carry(120, grasp, onset, release)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    segment = manipulation_segment(positions @ turn.T + shift, turn @ _still(120), gripper)
    assert segment == (max(0, onset - 4), min(120, release + 6), onset, release)
    assert 0 <= segment.start <= segment.onset < segment.release < segment.stop <= 120


def test_padding_is_configurable():
    positions, gripper = _carry()
    segment = manipulation_segment(positions, _still(100), gripper, SegmentRule(before=0, after=0))
    assert (segment.start, segment.stop, segment.length) == (35, 81, 46)


@pytest.mark.parametrize("gripper", [None, np.full(100, OPEN), np.full(100, CLOSED)])
def test_no_manipulation_is_an_error(gripper):
    with pytest.raises(DatasetError, match=r"no manipulation in 100 steps.*leave this demonstration out"):
        manipulation_segment(np.zeros((100, 3)), _still(100), gripper)


def test_bad_arrays():
    positions, gripper = _carry()
    with pytest.raises(ShapeError, match=r"\(100, 2\)"):
        manipulation_segment(positions[:, :2], _still(100), gripper)
    with pytest.raises(ShapeError, match=r"\(99,\), expected \(100,\)"):
        manipulation_segment(positions, _still(100), gripper[1:])
    with pytest.raises(DatasetError, match="too few"):
        manipulation_segment(positions[:1], _still(1), gripper[:1])
    positions[3, 1] = np.nan
    with pytest.raises(InvalidValueError, match="positions"):
        manipulation_segment(positions, _still(100), gripper)


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("demo_0", (51, 122)),
        ("demo_8", (64, 152)),  # the nut is bumped at step 35, and still settling at the end
        ("demo_17", (65, 174)),  # set down leaning on the peg
        ("demo_26", (68, 130)),  # opened at 124 on the peg's top, pushed down with the open hand until 180
        ("demo_53", (56, 139)),
        ("demo_191", (43, 114)),  # closes again at 139, long after the release
        ("demo_197", (81, 185)),
    ],
)
def test_irregular_human_demonstrations(square_ph, name, kept):
    demo = Demonstrations(square_ph)[name]
    segment = manipulation_segment(*demo.object_poses("SquareNut"), demo.actions[:, -1])
    assert (segment.start, segment.stop) == kept


def test_all_human_demonstrations(square_ph):
    heights, lengths = [], []
    for demo in Demonstrations(square_ph):
        positions, rotations = demo.object_poses("SquareNut")
        segment = manipulation_segment(positions, rotations, demo.actions[:, -1])
        lengths.append(segment.length)
        heights.append(positions[segment.release, 2])
        assert positions[segment.onset, 2] < 0.84  # on the table
        assert np.linalg.norm(positions[segment.release, :2] - [0.23, 0.10]) < 0.03  # over the peg
    assert (min(lengths), max(lengths)) == (57, 155)
    assert np.median(heights) == pytest.approx(0.918, abs=2e-3)
