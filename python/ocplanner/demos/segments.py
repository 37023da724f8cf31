"""The part of a demonstration in which the robot manipulates the object: from grasp to release.

The planner learns only from these frames (the paper's preprocessing). Before them the object rests, or settles after
it was dropped into the scene; after them it is free again.

Only where the object is decides, never how fast it got there: a recording that is slowed down, paused or resampled
keeps the same poses.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ocplanner.errors import DatasetError, InvalidValueError, ShapeError
from ocplanner.geometry.rotation import angles_between


class Segment(NamedTuple):
    """The steps of a demonstration in which the object is manipulated.

    Attributes:
        start: first step, a few before the onset.
        stop: one past the last step.
        onset: the last step before the held object leaves its place.
        release: the step whose action opens the gripper for the last time. Without gripper actions, or if the gripper
            never opens, the step at which the object has come to its last place.
        rows: the kept steps in ``start ... stop - 1``: those between onset and end in which the object stands still are
            left out, because they would teach it to stand still.
    """

    start: int
    stop: int
    onset: int
    release: int
    rows: tuple[int, ...]

    @property
    def length(self) -> int:
        """Number of kept steps."""
        return len(self.rows)


@dataclass(frozen=True)
class SegmentRule:
    """What counts as manipulation. All lengths are displacements between two poses, not speeds.

    Attributes:
        before: steps kept before the onset, in which the object rests.
        moving: the object has left its place if it is farther from it than this (m)...
        turning: ...or turned by more than this angle (rad).
        idle: a step is left out if the object has moved by less than this since the last kept step (m)...
        idle_turn: ...and turned by less than this (rad).
        carried: a closed gripper carried the object if it shifted it horizontally by more than this (m)...
        lifted: ...or raised it by more than this (m). A fall is neither.
        turned: without gripper actions, an object that turned by more than this was manipulated too (rad).
        landed: a falling object has landed at this height above the lowest point (m).
        settling: an object that was dropped into the scene falls by no more than this before it rests (m); one that is
            lowered farther is carried.
        fall: how much of the fall after the release is kept (m): as much as while fingers open. Where it tumbles to
            afterwards is nothing that a hand could lead it to.
        at_rest: whether the manipulation ends when the object has come to its last place in the hand, not when the
            gripper opens.
    """

    before: int = 4
    moving: float = 0.002
    turning: float = 0.035
    idle: float = 0.0005
    idle_turn: float = 0.005
    carried: float = 0.03
    lifted: float = 0.01
    turned: float = 0.2
    landed: float = 0.001
    settling: float = 0.15
    fall: float = 0.015
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
    where the object leaves its place in the first of these spans, ends where the last of them opens, and goes on for
    the beginning of the fall. This leaves out bumps before the grasp, missed grasps, and a gripper that closes again
    after the release. Without gripper actions, the segment spans from the first motion after the settling to the last.

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
    path = _Path(object_positions, object_rotations, rule)
    settled = path.settling(steps)
    held = gripper_actions is not None
    spans = closed_spans(gripper_actions) if gripper_actions is not None else [(0, steps - 1)]
    carries = [(begin, end) for close, end in spans if path.carries(begin := max(close, settled), end, turns=not held)]
    if not carries:
        raise DatasetError(
            f"no manipulation in {steps} steps: the object is never carried or lifted"
            + (" while the gripper is closed" if held else "")
            + "; leave this demonstration out"
        )
    onset = path.leaves(*carries[0])
    release = carries[-1][1]
    opened = gripper_actions is not None and gripper_actions[release] < 0
    if rule.at_rest or not opened:
        release = path.arrives(onset, release)
    last = release
    if opened and not rule.at_rest:
        closes = next((close for close, _ in spans if close > release), steps)
        last = path.falls(release, path.landing(release, closes))
    start = max(min(settled, onset), onset - rule.before)
    return Segment(start, last + 1, onset, release, path.kept(start, onset, release, last))


class _Path:
    """Where an object is in each step, and what that says; every rule is about displacements."""

    def __init__(self, positions: np.ndarray, rotations: np.ndarray, rule: SegmentRule) -> None:
        self._positions, self._rotations, self._rule = positions, rotations, rule

    def landing(self, begin: int, stop: int) -> int:
        """The step from which an object that falls from ``begin`` on lies; ``begin`` if it does not fall.

        A fall ends where the object rises again, at the latest before ``stop``.
        """
        height = self._positions[begin:stop, 2]
        lowest = np.minimum.accumulate(height)
        rises = np.flatnonzero(height > lowest + self._rule.lifted)
        fall = height[: rises[0]] if len(rises) else height
        return begin + int(np.argmax(fall <= fall.min() + self._rule.landed))

    def settling(self, steps: int) -> int:
        """The step from which an object that was dropped into the scene lies; 0 if it was not."""
        landed = self.landing(0, steps)
        return landed if self._positions[0, 2] - self._positions[landed, 2] < self._rule.settling else 0

    def carries(self, begin: int, end: int, *, turns: bool) -> bool:
        """Whether the object is carried or lifted from ``begin`` to ``end``, or, if that counts, turned."""
        if begin >= end:
            return False
        rule, path = self._rule, self._positions[begin : end + 1]
        shifted = np.linalg.norm(path[:, :2] - path[0, :2], axis=1).max() > rule.carried
        raised = (path[:, 2] - np.minimum.accumulate(path[:, 2])).max() > rule.lifted
        return bool(shifted or raised or (turns and self._apart(begin, begin, end + 1)[1].max() > rule.turned))

    def leaves(self, begin: int, end: int) -> int:
        """The last step, before it is carried, at which the object is still where it was at ``begin``."""
        rule, path = self._rule, self._positions[begin : end + 1]
        distance, angle = self._apart(begin, begin, end + 1)
        away = (
            (np.linalg.norm(path[:, :2] - path[0, :2], axis=1) > rule.carried)
            | (path[:, 2] - np.minimum.accumulate(path[:, 2]) > rule.lifted)
            | (angle > rule.turned)
        )
        until = int(np.argmax(away)) or len(path) - 1
        return begin + int(np.flatnonzero((distance <= rule.moving) & (angle <= rule.turning))[: until + 1][-1])

    def arrives(self, begin: int, end: int) -> int:
        """The first step from which the object stays where it is at ``end``."""
        distance, angle = self._apart(end, begin, end + 1)
        away = np.flatnonzero((distance > self._rule.moving) | (angle > self._rule.turning))
        return begin + int(away[-1]) + 1 if len(away) else begin

    def falls(self, begin: int, landed: int) -> int:
        """The last step of a fall at which the object is still near where it began."""
        away = np.flatnonzero(self._apart(begin, begin, landed + 1)[0] > self._rule.fall)
        return begin + int(away[0]) - 1 if len(away) else landed

    def kept(self, start: int, onset: int, release: int, last: int) -> tuple[int, ...]:
        """The steps before the onset, then those in which the object is elsewhere than at the last kept one."""
        rows = [*range(start, onset + 1)]
        for step in range(onset + 1, last + 1):
            distance, angle = self._apart(rows[-1], step, step + 1)
            if distance[0] > self._rule.idle or angle[0] > self._rule.idle_turn or step in (release, last):
                rows.append(step)
        return tuple(rows)

    def _apart(self, one: int, first: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        """Distance (m) and angle (rad) of the steps ``first ... stop - 1`` from the step ``one``."""
        distance = np.linalg.norm(self._positions[first:stop] - self._positions[one], axis=1)
        return distance, angles_between(
            np.broadcast_to(self._rotations[one], (stop - first, 3, 3)), self._rotations[first:stop]
        )


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


def closed_spans(gripper: np.ndarray) -> list[tuple[int, int]]:
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
