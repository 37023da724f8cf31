"""Making a held object follow a plan that is renewed every few steps.

Decisions rest on the plans, the object's pose and nothing else: no peg pose, no success flag.
"""

from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from ocplanner import _core
from ocplanner.pose import Pose
from ocplanner.transfer.settings import TransferSettings
from ocplanner.transfer.symmetry import angle_between, mean_rotation, nearest_equivalent

Phase = Literal["lift", "transit", "align", "lower", "unstick", "release"]

# Places tried after wedging, in units of the search radius: the estimate itself, then a ring around it.
_SEARCH = np.array(
    [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
)


class Command(NamedTuple):
    """Where the object should go now, and why."""

    target: Pose
    phase: Phase


class Follower:
    """Follows successive plans of one object.

    Args:
        settings: modes and thresholds.
        yaw_fold: symmetry of the goal, see :class:`ocplanner.envs.tasks.ObjectSpec`.
        start: pose of the object when it was taken.
        law: the action law, for the open-loop and timed modes' controller.
    """

    def __init__(self, settings: TransferSettings, yaw_fold: int, start: Pose, law: _core.DeltaPoseLaw) -> None:  # noqa: D107
        self.settings = settings
        self._rule = settings.following
        self._yaw_fold = yaw_fold
        self._controller = _core.DeltaPoseController(
            settings.follow,
            gate_position=self._rule.gate_position,
            gate_rotation=self._rule.gate_rotation,
            law=law,
        )
        self._start = start
        self._previous = start
        self._top = start.position[2]
        self._lifted = False
        self._ends: deque[Pose] = deque(maxlen=self._rule.goal_memory)
        self._plan_top = start.position[2]
        self._still = 0
        self._aligning = 0
        self._lowering = False
        self._attempt = 0
        self._unstick: Pose | None = None
        self._unstick_steps = 0

    def receive(self, positions: np.ndarray, rotations: np.ndarray | None, now: Pose) -> None:
        """Take a new plan.

        Args:
            positions: (H, 3) world, metres.
            rotations: (H, 3, 3), or None for a position-only plan.
            now: the object's pose.
        """
        if rotations is not None:
            # one turn for the whole plan, chosen near the rotation it has: no jumps within a plan
            first = nearest_equivalent(rotations[0], now.rotation, self._yaw_fold)
            turn = rotations[0].T @ first
            rotations = rotations @ turn
        self._controller.set_plan(np.ascontiguousarray(positions), rotations, now)
        end = Pose(positions[-1], now.rotation if rotations is None else rotations[-1])
        self._plan_top = float(np.max(positions[:, 2]))
        self._top = max(self._top, now.position[2])
        if end.position[2] < self._top - self._rule.lowering and self._has_lifted(now):
            self._ends.append(end)
        elif self._ends and not self._lowering:
            self._ends.popleft()

    def command(self, now: Pose) -> Command:
        """Where to move the object in this control step; phase ``release`` means let go."""
        moved = float(np.linalg.norm(now.position - self._previous.position))
        self._still = self._still + 1 if moved < self._rule.stuck else 0
        self._previous = now
        self._top = max(self._top, now.position[2])
        target = Pose(*self._controller.target(now))
        if self.may_release(now, moved):
            return Command(now, "release")
        if self.settings.follow != "gated":
            return Command(target, "transit")
        command = self._gated(now, target, moved)
        return command

    @property
    def goal(self) -> Pose | None:
        """Where the plans let the object down: the middle of the last plans' ends; None while they do not."""
        if not self._ends:
            return None
        ends = np.array([end.position for end in self._ends])
        position = np.append(np.median(ends[:, :2], axis=0), np.quantile(ends[:, 2], self._rule.depth))
        reference = self._ends[-1].rotation
        near = [nearest_equivalent(end.rotation, reference, self._yaw_fold) for end in self._ends]
        return Pose(position, mean_rotation(np.array(near)))

    def _has_lifted(self, now: Pose) -> bool:
        return self._lifted or now.position[2] > self._start.position[2] + self._rule.lift_first

    def may_release(self, now: Pose, moved: float = 0.0) -> bool:
        """Whether the plans are fulfilled: the object is below where they end, or rests there and will go no lower."""
        goal = self.goal
        if goal is None:
            return False
        away = now.position - goal.position
        if np.linalg.norm(away[:2]) > self._rule.release:
            return False
        if away[2] < 0.0:
            return True
        blind = self.settings.follow != "gated"
        return bool(
            away[2] < self._rule.release
            and moved < self._rule.resting
            and (blind or self._attempt >= self._rule.attempts)
        )

    def _gated(self, now: Pose, target: Pose, moved: float) -> Command:
        if self._unstick is not None:
            self._unstick_steps += 1
            if self._unstick_steps < 14 and now.position[2] < self._unstick.position[2] - 0.01:
                return Command(self._unstick, "unstick")
            self._unstick = None
            self._still = 0
        if not self._has_lifted(now) and self._plan_top > self._start.position[2] + 0.02:
            height = self._start.position[2] + self._rule.lift_first + 0.02
            return Command(Pose(np.array([*self._start.position[:2], height]), self._start.rotation), "lift")
        self._lifted = True
        goal = self.goal
        if goal is None:
            self._lowering = False
            if self._still >= self._rule.stuck_steps:
                return self._come_free(now, target)
            return Command(target, "transit")
        return self._let_down(now, goal, moved)

    def _let_down(self, now: Pose, goal: Pose, moved: float) -> Command:
        rule = self._rule
        rotation = nearest_equivalent(goal.rotation, now.rotation, self._yaw_fold)
        offset = rule.search * (1 + self._attempt // len(_SEARCH)) * _SEARCH[self._attempt % len(_SEARCH)]
        place = goal.position + [*offset, 0.0]
        away = float(np.linalg.norm(now.position[:2] - place[:2]))
        if not self._lowering:
            self._aligning += 1
            slack = 2.0 if self._aligning > rule.patience else 1.0
            if (
                away < slack * rule.aligned
                and angle_between(now.rotation, rotation) < slack * rule.aligned_rotation
                and moved < 2 * rule.resting
            ):
                self._lowering = True
                self._still = 0
            else:
                held = np.array([*place[:2], self._top])
                return Command(Pose(held, rotation), "align")
        if self._still >= rule.stuck_steps and now.position[2] > goal.position[2] + rule.release:
            self._attempt += 1
            self._lowering = False
            self._aligning = 0
            return self._come_free(now, goal)
        return Command(Pose(place - [0.0, 0.0, rule.press], rotation), "lower")

    def _come_free(self, now: Pose, toward: Pose) -> Command:
        self._unstick = Pose(now.position + [0.0, 0.0, self._rule.unstick_lift], now.rotation)
        self._unstick_steps = 0
        return Command(self._unstick, "unstick")
