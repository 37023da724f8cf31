"""From grasp to release: on drawn trajectories, and on the recordings that people made."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.segments import Segment, SegmentRule, manipulation_segment
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


def _seen(segment: Segment) -> tuple[int, int, int, int]:
    return segment.start, segment.stop, segment.onset, segment.release


def test_from_onset_to_the_beginning_of_the_fall():
    positions, gripper = _carry()
    positions[81:85, 2] = [0.098, 0.086, 0.05, 0.0]
    segment = manipulation_segment(positions, _still(100), gripper)
    assert _seen(segment) == (31, 83, 35, 80)
    assert segment.rows == (*range(31, 83),)


def test_a_hand_that_holds_still_for_another_has_ended_its_part():
    positions, gripper = _carry()
    positions[60:] = positions[60]
    segment = manipulation_segment(positions, _still(100), gripper, SegmentRule(at_rest=True))
    assert _seen(segment) == (31, 61, 35, 60)
    assert manipulation_segment(positions, _still(100), gripper).release == 80


def test_without_gripper_actions_the_motion_decides():
    positions, _ = _carry()
    segment = manipulation_segment(positions, _still(100), None)
    assert (segment.start, segment.onset) == (31, 35)
    assert segment.release == 82  # where it lies for good


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
    assert segment.rows[0] == 6


def test_bumps_and_missed_grasps_before_are_left_out():
    positions, gripper = _carry()
    positions[15:, 0] += 0.003 * np.clip(np.arange(85), 0, 4)  # pushed 12 mm while the gripper is open
    gripper[22:26] = CLOSED  # and a grasp that misses
    assert manipulation_segment(positions, _still(100), gripper).onset == 35


def test_a_second_grasp_continues_the_manipulation():
    positions, gripper = _carry()
    gripper[50:55] = OPEN
    assert _seen(manipulation_segment(positions, _still(100), gripper)) == (31, 82, 35, 80)


def test_closing_again_after_the_release_is_left_out():
    positions, gripper = _carry()
    gripper[81:] = CLOSED  # the object falls meanwhile: no carry
    assert manipulation_segment(positions, _still(100), gripper).release == 80


def test_never_opened():
    positions, gripper = _carry()
    gripper[30:] = CLOSED
    positions[:, 2] = np.where(np.arange(100) > 35, 0.1, 0.0)
    segment = manipulation_segment(positions, _still(100), gripper)
    assert (segment.release, segment.stop) == (80, 81)


def test_turning_in_place_counts_as_motion():
    angle = 0.05 * np.clip(np.arange(100) - 40, 0, 20)
    rotations = np.zeros((100, 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(angle)
    rotations[:, 1, 0], rotations[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rotations[:, 2, 2] = 1
    segment = manipulation_segment(np.zeros((100, 3)), rotations, None)
    assert (segment.onset, segment.release) == (40, 60)


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
    assert _seen(segment) == (max(0, onset - 4), min(120, release + 2), onset, release)
    assert 0 <= segment.start <= segment.onset < segment.release < segment.stop <= 120


def test_stop_and_go():
    """Keyboards move the hand in steps, with pauses between them: none is long or fast."""
    height = np.cumsum([0] * 42 + [0.0043, 0.0041, 0.0007] * 12)
    positions = np.column_stack([0 * height, 0 * height, height])
    gripper = np.r_[np.full(40, OPEN), np.full(38, CLOSED)]
    segment = manipulation_segment(positions, _still(78), gripper)
    assert _seen(segment) == (37, 77, 41, 76)  # the last step of all is within 2 mm of the one before
    assert np.ptp(height[list(segment.rows)]) == pytest.approx(np.ptp(height), abs=1e-3)


def test_steps_in_which_it_stands_still_are_left_out():
    positions, gripper = _carry()
    paused = np.insert(np.arange(100), 50, [50] * 40)
    segment = manipulation_segment(positions[paused], _still(140), gripper[paused])
    assert segment.length == manipulation_segment(positions, _still(100), gripper).length
    assert 51 not in segment.rows


def _at_other_times(positions: np.ndarray, gripper: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, ...]:
    """A recording as seen at other times, in steps of the old one: the object in between, the gripper's last action."""
    before = np.floor(times).astype(int)
    after, share = np.minimum(before + 1, len(positions) - 1), (times % 1)[:, None]
    return positions[before] * (1 - share) + positions[after] * share, gripper[before]


@given(data=st.data(), slower=st.sampled_from([1, 2, 3, 4, 10]), pause=st.integers(0, 200))
def test_the_same_poses_are_kept_at_any_pace(data, slower, pause):
    """Slowed down, or paused for seconds."""
    onset, release = data.draw(st.integers(31, 50)), data.draw(st.integers(60, 90))
    positions, gripper = _carry(120, 30, onset, release)
    kept = positions[list(manipulation_segment(positions, _still(120), gripper).rows)]
    times = np.arange(0, 119 + 1e-9, 1 / slower)
    at = data.draw(st.integers(0, len(times) - 1))
    times = np.insert(times, at, np.full(pause, times[at]))
    changed, closed = _at_other_times(positions, gripper, times)
    found = changed[list(manipulation_segment(changed, _still(len(times)), closed).rows)]
    near = np.abs(found[:, None] - kept[None]).sum(axis=2)
    assert near.min(axis=0).max() < 2 * SegmentRule().idle  # each of the kept poses is still there
    np.testing.assert_allclose(found[0], kept[0], atol=SegmentRule().moving)
    np.testing.assert_allclose(found[-1], kept[-1], atol=SegmentRule().fall)


@given(every=st.integers(2, 5), phase=st.integers(0, 4))
def test_fewer_steps_of_the_same_motion_begin_and_end_alike(every, phase):
    """A recording at 4 to 10 Hz."""
    positions, gripper = _carry(200, 60, 70, 160)
    thin = slice(phase, None, every)
    segment = manipulation_segment(positions[thin], _still(len(positions[thin])), gripper[thin])
    begin, end = (np.arange(200)[thin][step] for step in (segment.onset, segment.release))
    assert abs(begin - 70) <= every
    assert abs(end - 160) <= every


def test_padding_is_configurable():
    positions, gripper = _carry()
    segment = manipulation_segment(positions, _still(100), gripper, SegmentRule(before=0, fall=0.0))
    assert (segment.start, segment.stop, segment.length) == (35, 82, 47)


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
        ("demo_0", (51, 121)),
        ("demo_8", (64, 154)),  # the nut is bumped at step 35, and still settling at the end
        ("demo_17", (64, 171)),  # set down leaning on the peg
        ("demo_26", (62, 177)),  # opened at 124 on the peg's top, pushed down with the open hand until 180
        ("demo_53", (56, 135)),
        ("demo_191", (43, 112)),  # closes again at 139, long after the release
        ("demo_197", (78, 186)),
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
        assert positions[segment.onset, 2] < 0.841  # on the table
        assert np.linalg.norm(positions[segment.release, :2] - [0.23, 0.10]) < 0.03  # over the peg
    assert (min(lengths), max(lengths)) == (58, 160)
    assert np.median(heights) == pytest.approx(0.918, abs=2e-3)


def test_an_object_that_is_lowered_far_does_not_settle():
    positions = np.zeros((100, 3))
    positions[:, 2] = 0.3 - 0.01 * np.clip(np.arange(100) - 40, 0, 30)
    positions[:, 0] = 0.01 * np.clip(np.arange(100) - 40, 0, 30)
    gripper = np.where((np.arange(100) >= 30) & (np.arange(100) < 90), CLOSED, OPEN)
    assert manipulation_segment(positions, _still(100), gripper).onset == 40
