import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.holding import held_steps

OPEN, CLOSED = -1.0, 1.0
STEPS, GRASP, ONSET, RELEASE = 100, 30, 35, 80


def carry() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    positions = np.zeros((STEPS, 3))
    positions[:, 0] = 0.01 * np.clip(np.arange(STEPS) - ONSET, 0, RELEASE - ONSET)
    gripper = np.where((np.arange(STEPS) >= GRASP) & (np.arange(STEPS) < RELEASE), CLOSED, OPEN)
    return positions, np.tile(np.eye(3), (STEPS, 1, 1)), gripper


def test_from_the_first_motion_to_the_last_step_before_the_release():
    positions, rotations, gripper = carry()
    assert np.flatnonzero(held_steps(positions, rotations, gripper)).tolist() == list(range(ONSET, RELEASE))


def test_not_while_the_gripper_is_open_in_between():
    positions, rotations, gripper = carry()
    gripper[50:55] = OPEN
    expected = [*range(ONSET, 50), *range(55, RELEASE)]
    assert np.flatnonzero(held_steps(positions, rotations, gripper)).tolist() == expected


def test_a_command_of_zero_keeps_the_grip():
    positions, rotations, gripper = carry()
    gripper[GRASP + 1 : RELEASE] = 0.0
    assert np.flatnonzero(held_steps(positions, rotations, gripper)).tolist() == list(range(ONSET, RELEASE))


def test_nothing_is_held_where_nothing_is_carried():
    positions, rotations, gripper = carry()
    assert not held_steps(0 * positions, rotations, gripper).any()
    assert not held_steps(positions, rotations, np.full(STEPS, OPEN)).any()


def test_held_objects_move_with_the_hand(square_ph):
    with Demonstrations(square_ph) as demos:
        for demo in demos[:5]:
            positions, rotations = demo.object_poses("SquareNut")
            held = held_steps(positions, rotations, demo.actions[:, -1])
            assert held.sum() > 30
            offset = np.einsum("tji,tj->ti", rotations, demo.eef_positions - positions)[held]
            assert np.linalg.norm(offset - np.median(offset, axis=0), axis=1).max() < 0.03
