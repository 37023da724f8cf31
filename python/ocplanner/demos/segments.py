"""The part of a demonstration in which the robot manipulates the object: from grasp to release.

The planner learns only from these frames (the paper's preprocessing). Before them the object rests, or settles after
it was dropped into the scene; after them it is free again.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ocplanner.errors import DatasetError, InvalidValueError, ShapeError
from ocplanner.geometry.rotation import angles_between


class Segment(NamedTuple):
    """Steps of a demonstration, of which ``[start:stop]`` are kept.

    Attributes:
        start: first kept step, a few before the onset.
        stop: one past the last kept step, a few after the release.
        onset: the step from which the grasped object moves.
        release: the step whose action opens the gripper for the last time, or, without gripper actions, the last step
            in which the object moves.
    """

    start: int
    stop: int
    onset: int
    release: int

    @property
    def length(self) -> int:
        """Number of kept steps."""
        return self.stop - self.start


@dataclass(frozen=True)
class SegmentRule:
    """What counts as manipulation; the defaults suit 20 Hz recordings.

    Attributes:
        before: steps kept before the onset.
        after: steps kept after the release.
        moving: the object moves if it covers more than this distance in a step (m)...
        turning: ...or turns by more than this angle (rad)...
        sustained: ...in so many consecutive steps.
        resting: the object has settled if it moves by less than this in a step (m, rad).
        settling: the object settles for at most so many steps at the start.
        carried: a closed gripper carried the object if it shifted it horizontally by more than this (m)...
        lifted: ...or raised it by more than this (m). A fall is neither.
        at_rest: whether the manipulation ends when the object comes to rest for good, not when the gripper opens.
    """

    before: int = 4
    after: int = 5
    moving: float = 0.002
    turning: float = 0.035
    sustained: int = 3
    resting: float = 0.0005
    settling: int = 20
    carried: float = 0.03
    lifted: float = 0.01
    at_rest: bool = False


DEFAULT_RULE = SegmentRule()


def manipulation_segment(
    object_positions: np.ndarray,
    object_rotations: np.ndarray,
    gripper_actions: np.ndarray | None,
    rule: SegmentRule = DEFAULT_RULE,
) -> Segment:
    """Find the steps from grasp to release.

    With gripper actions, the spans count in which the closed gripper carries or lifts the object. The segment begins
    where the object starts to move in the first of these spans and ends where the last of them opens. This leaves out
    bumps before the grasp, missed grasps, and a gripper that closes again after the release. Without gripper actions,
    the segment spans from the first sustained motion after the settling to the last.

    Args:
        object_positions: (T, 3) world, metres.
        object_rotations: (T, 3, 3), object -> world.
        gripper_actions: (T,), above 0 closes, below 0 opens, 0 changes nothing; or None.
        rule: thresholds.

    Raises:
        ShapeError: the arrays do not fit together.
        InvalidValueError: a number is not finite, or a matrix is not a rotation.
        DatasetError: the object is never manipulated.
    """
    steps = _check(object_positions, object_rotations, gripper_actions)
    speed, turn = _step_motion(object_positions, object_rotations)
    settled = _settled(speed, turn, rule)
    moves = _sustained((speed > rule.moving) | (turn > rule.turning), rule.sustained)
    moves[:settled] = False
    if gripper_actions is None:
        spans = [(settled, steps - 1)]
    else:
        spans = [span for span in _closed_spans(gripper_actions) if _carries(object_positions, span, settled, rule)]
    for close, opened in spans:
        moving = np.flatnonzero(moves[close : opened + 1])
        if len(moving):
            onset = close + int(moving[0])
            break
    else:
        raise DatasetError(
            f"no manipulation in {steps} steps: the object is never carried or lifted"
            + ("" if gripper_actions is None else " while the gripper is closed")
            + "; leave this demonstration out"
        )
    release = spans[-1][1]
    if rule.at_rest:
        release = int(np.flatnonzero(moves[:release])[-1])
    elif gripper_actions is None or release == steps - 1:  # never opened: the manipulation ends with the last motion
        release = int(np.flatnonzero(moves)[-1])
    start = max(settled, onset - rule.before)
    return Segment(start, min(steps, release + rule.after + 1), onset, release)


def _check(positions: np.ndarray, rotations: np.ndarray, gripper: np.ndarray | None) -> int:
    steps = len(positions)
    if positions.shape != (steps, 3) or rotations.shape != (steps, 3, 3):
        raise ShapeError(f"positions {positions.shape} and rotations {rotations.shape}, expected (T, 3) and (T, 3, 3)")
    if gripper is not None and gripper.shape != (steps,):
        raise ShapeError(f"gripper actions {gripper.shape}, expected ({steps},)")
    if steps < 2:
        raise DatasetError(f"{steps} step(s) are too few to find a manipulation in; leave this demonstration out")
    for name, array in (("positions", positions), ("rotations", rotations), ("gripper actions", gripper)):
        if array is not None and not np.all(np.isfinite(array)):
            raise InvalidValueError(f"the object's {name} contain NaN or infinity; leave this demonstration out")
    return steps


def _step_motion(positions: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (m) and angle (rad) from step t to t + 1; both (T,), the last one zero."""
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    turn = angles_between(rotations[:-1], rotations[1:])
    return np.append(speed, 0.0), np.append(turn, 0.0)


def _settled(speed: np.ndarray, turn: np.ndarray, rule: SegmentRule) -> int:
    """The first step at rest; 0 if the object does not come to rest soon."""
    resting = np.flatnonzero((speed < rule.resting) & (turn < rule.resting))
    return int(resting[0]) if len(resting) and resting[0] <= rule.settling else 0


def _sustained(moving: np.ndarray, run: int) -> np.ndarray:
    """Keep the true entries in runs of at least ``run``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(np.int8), [0]])))
    kept = np.zeros_like(moving)
    for begin, end in edges.reshape(-1, 2):
        kept[begin:end] = end - begin >= run
    return kept


def _closed_spans(gripper: np.ndarray) -> list[tuple[int, int]]:
    """(first closing step, step of the opening action or the last step) of each span with a closed gripper."""
    spans: list[tuple[int, int]] = []
    close: int | None = None
    for step, action in enumerate(gripper):
        if action > 0 and close is None:
            close = step
        elif action < 0 and close is not None:
            spans.append((close, step))
            close = None
    if close is not None:
        spans.append((close, len(gripper) - 1))
    return spans


def _carries(positions: np.ndarray, span: tuple[int, int], settled: int, rule: SegmentRule) -> bool:
    begin = max(span[0], settled)
    if begin >= span[1]:
        return False
    shift = positions[begin : span[1] + 1] - positions[begin]
    shifted = np.linalg.norm(shift[:, :2], axis=1).max()
    return bool(shifted > rule.carried or shift[:, 2].max() > rule.lifted)
