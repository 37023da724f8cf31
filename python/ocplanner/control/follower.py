"""Making a held object follow a plan that is renewed every few steps.

Decisions rest on the plans, the object's pose and where the hand holds it: no peg pose, no success flag.
"""

from collections import deque
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import Reachability, Reading
from ocplanner.control.settings import ControlSettings
from ocplanner.envs.tasks.task import Placing
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between, mean_rotation
from ocplanner.geometry.symmetry import equivalents, nearest_equivalent

Phase = Literal["lift", "transit", "align", "lower", "unstick", "release", "keep", "hand over"]

# Places tried after wedging, in units of the search radius: the estimate itself, then a ring around it.
_SEARCH = np.array(
    [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
)
_UNSTICK_STEPS = 14
_CLOSING_IN = 0.08  # m; a plan that leads no farther away is traced exactly
_WEDGED, _WEDGED_STEPS = 0.005, 16  # m; an object that is traced and moves less in so many steps is wedged
_SLOW = 1.0  # times the speed at rest
_LEVER = 0.1  # m; a turn by a radian counts as that much motion where turning matters
_LIFTING = 0.02  # m; a plan that rises by less does not lift


class Command(NamedTuple):
    """Where the object should go now, and why.

    ``release``: let go; ``keep``: it is there and stays in the hand; ``hand over``: it is there for another hand.
    """

    target: Pose
    phase: Phase


class Follower:
    """Follows successive plans of one object.

    Args:
        settings: modes and thresholds.
        yaw_fold: symmetry of the goal, see :class:`ocplanner.envs.tasks.ObjectSpec`.
        start: what is sensed when the object has just been taken.
        reach: where the arm gets to; without it every pose counts as reachable.
        let_go: whether the object is let go of at the end, see :class:`ocplanner.envs.tasks.ObjectSpec`.
        placing: how it gets there, see the same.
        tolerance: how exactly, metres and radians; the settings' numbers if not given.
        descent: how fast it is let down, see the same; the settings' number if not given.
        hands_over: whether the plan ends where another hand takes the object.
        turned: (3, 3) rotation in which the object is carried where a plan does not say; that at the start if not
            given.
        lift: how far up it goes first, and along its own z, see the same; the settings' number if not given.
    """

    def __init__(
        self,
        settings: ControlSettings,
        yaw_fold: int,
        start: Reading,
        reach: Reachability | None = None,
        *,
        let_go: bool = True,
        placing: Placing = "drop",
        tolerance: tuple[float, float] | None = None,
        descent: float | None = None,
        hands_over: bool = False,
        turned: np.ndarray | None = None,
        lift: tuple[float, float] | None = None,
    ) -> None:
        self.settings = settings
        self._lets_go = let_go
        self._placing = placing
        self._rule = settings.following
        if tolerance is not None:
            near = max(self._rule.release, 2 * tolerance[0])
            self._rule = replace(self._rule, aligned=tolerance[0], aligned_rotation=tolerance[1], release=near)
        if descent is not None:
            self._rule = replace(self._rule, lower_step=descent)
        self._drawn = np.zeros(3)
        if lift is not None:
            self._rule = replace(self._rule, lift_first=lift[0])
            self._drawn = lift[1] * start.object.rotation[:, 2] * [1, 1, 0]
        self._hands_over = hands_over
        self._yaw_fold = yaw_fold
        self._controller = _core.DeltaPoseController(
            settings.follow, gate_position=self._rule.gate_position, gate_rotation=self._rule.gate_rotation
        )
        self._exact_controller = _core.DeltaPoseController(
            settings.follow, gate_position=self._rule.aligned, gate_rotation=self._rule.aligned_rotation
        )
        self._closing_in = False
        self._aim: Pose | None = None
        self._reach = reach
        self._turned: np.ndarray | None = None
        self._plans_rotation = True
        self._carried = start.object.rotation if turned is None else turned
        self._start = start.object
        self._previous = start.object
        self._top = float(start.object.position[2])
        self._plan_top = self._top
        self._lifted = False
        self._still = 0
        self._ends: deque[Pose] = deque(maxlen=self._rule.goal_memory)
        self._last_ends: deque[Pose] = deque(maxlen=self._rule.goal_memory // 3)
        self._hold: float | None = None
        self._aligning = 0
        self._lowering: Reading | None = None
        self._attempt = 0
        self._track: deque[Pose] = deque(maxlen=_WEDGED_STEPS)
        self._unstick: Pose | None = None
        self._unstick_steps = 0

    def receive(self, positions: np.ndarray, rotations: np.ndarray | None, now: Reading) -> None:
        """Take a new plan.

        Args:
            positions: (H, 3) world, metres.
            rotations: (H, 3, 3), or None for a position-only plan: the object is then carried as ``turned`` says.
            now: what is sensed.
        """
        if rotations is not None:
            rotations = self._turn(positions, rotations, now)
        positions = np.ascontiguousarray(positions)
        self._controller.set_plan(positions, rotations, now.object)
        self._exact_controller.set_plan(positions, rotations, now.object)
        farthest = np.linalg.norm(positions - now.object.position, axis=1).max()
        self._closing_in = self._placing == "trace" and bool(farthest < _CLOSING_IN)
        self._plan_top = float(np.max(positions[:, 2]))
        self._top = max(self._top, float(now.object.position[2]))
        self._plans_rotation = rotations is not None
        end = Pose(positions[-1], self._carried if rotations is None else rotations[-1])
        self._last_ends.append(end)
        if self._hands_over:
            return
        if self._has_lifted(now.object) and end.position[2] < self._top - self._rule.lowering:
            self._ends.append(end)
        elif self._ends and self._lowering is None:
            self._ends.popleft()

    def command(self, now: Reading) -> Command:
        """Where to move the object in this control step."""
        here = now.object
        moved = float(np.linalg.norm(here.position - self._previous.position))
        if self._placing == "trace":
            moved = self._motion(self._previous, here)
        self._previous = here
        self._still = self._still + 1 if moved < self._rule.stuck else 0
        self._top = max(self._top, float(here.position[2]))
        target = self._target(here, moved)
        if self._hands_over:
            if self.has_arrived(here, moved):
                return Command(here, "hand over")
        elif not self._lets_go:
            if self.has_arrived(here, moved):
                return Command(here, "keep")
        elif self.may_release(here, moved):
            return Command(here, "release")
        if self.settings.follow != "gated":
            return Command(target, "transit")
        return self._gated(now, target, moved)

    def _target(self, here: Pose, moved: float) -> Pose:
        """The pose of the plan to aim at; one that is traced exactly keeps it until the object is slow."""
        if not self._closing_in:
            self._aim = None
            target = Pose(*self._controller.target(here))
            return target if self._plans_rotation else target._replace(rotation=self._carried)
        if self._aim is None or moved < _SLOW * self._rule.resting:
            self._aim = Pose(*self._exact_controller.target(here))
        return self._aim

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

    def has_arrived(self, here: Pose, moved: float = 0.0) -> bool:
        """Whether the object has been lifted, rests, and the last plans lead nowhere else."""
        if len(self._last_ends) < (self._last_ends.maxlen or 0) or not self._has_lifted(here):
            return False
        farthest = max(float(np.linalg.norm(end.position - here.position)) for end in self._last_ends)
        if self._placing != "trace":
            near = self._rule.meeting if self._hands_over else self._rule.release
            return farthest < near and moved < self._rule.resting
        widest = max(angle_between(end.rotation, here.rotation) for end in self._last_ends)
        slack = 4.0 if self._still > self._rule.patience else 2.0
        near = farthest < slack * self._rule.aligned and widest < slack * self._rule.aligned_rotation
        return near and moved < self._rule.resting

    def may_release(self, here: Pose, moved: float = 0.0) -> bool:
        """Whether the plans are fulfilled.

        An object that is led along the plan has arrived, one that is inserted has done so while it was let down. Any
        other has gone well below where they end, which only one that hangs free there can; or it rests at that height
        and coming free and trying again has not brought it lower. The blind modes do not press, so that for them
        resting there is enough.
        """
        if self._placing != "drop" and self.settings.follow == "gated":
            return (self._placing == "trace" or self._is_let_down(here)) and self.has_arrived(here, moved)
        goal, rule = self.goal, self._rule
        if goal is None:
            return False
        away = here.position - goal.position
        if np.linalg.norm(away[:2]) > rule.release:
            return False
        if away[2] < -0.6 * rule.press:
            return True
        patient = self.settings.follow != "gated" or self._attempt >= rule.attempts
        return bool(patient and away[2] < rule.release and moved < rule.resting)

    def _is_let_down(self, here: Pose) -> bool:
        """Whether the object has come down from where it was lined up, rather than rests on its way."""
        lowering = self._lowering
        return lowering is not None and bool(lowering.object.position[2] - here.position[2] > self._rule.lowering)

    def _turn(self, positions: np.ndarray, rotations: np.ndarray, now: Reading) -> np.ndarray:
        """The plan's rotations, all turned alike by the goal's symmetry: no jumps within a plan.

        The turn is the one nearest to the rotation that the object has, unless the arm does not reach the plan's end
        with it; then the nearest with which it does. Such a choice is kept, or the object would turn back halfway.
        """
        nearest, *others = equivalents(rotations[0], self._reference(now.object), self._yaw_fold)
        whole = rotations @ (rotations[0].T @ nearest)
        reach = self._reach
        if reach is None or self.settings.follow != "gated":
            return whole

        def miss(turned: np.ndarray) -> float:
            motion = Pose(positions[-1], turned[-1]) @ now.object.inverse()
            return reach.reach_error(motion @ now.eef)

        least = miss(whole)
        for other in others:
            if least < self._rule.reach:
                break
            turned = rotations @ (rotations[0].T @ other)
            if (missed := miss(turned)) < least - self._rule.reach:
                least, whole = missed, turned
                self._turned = other
        if self._turned is not None:
            self._turned = whole[0]
        return whole

    def _reference(self, here: Pose) -> np.ndarray:
        """(3, 3) rotation near which equivalent ones are chosen."""
        return here.rotation if self._turned is None else self._turned

    def _has_lifted(self, here: Pose) -> bool:
        return self._lifted or bool(here.position[2] > self._start.position[2] + self._rule.lift_first)

    def _gated(self, now: Reading, target: Pose, moved: float) -> Command:
        here = now.object
        if self._unstick is not None:
            self._unstick_steps += 1
            if self._unstick_steps < _UNSTICK_STEPS and here.position[2] < self._unstick.position[2] - 0.01:
                return Command(self._unstick, "unstick")
            self._unstick = None
            self._still = 0
        if not self._has_lifted(here) and self._plan_top > self._start.position[2] + _LIFTING:
            above = self._start.raised(self._rule.lift_first + _LIFTING)
            return Command(above._replace(position=above.position + self._drawn), "lift")
        self._lifted = True
        if self._placing == "trace":
            return self._trace(here, target)
        goal = self.goal
        if goal is not None:
            return self._let_down(now, goal, moved)
        self._lowering = self._hold = None
        if self._still >= self._rule.stuck_steps:
            return self._come_free(here)
        return Command(target, "transit")

    def _let_down(self, now: Reading, goal: Pose, moved: float) -> Command:
        rule, here = self._rule, now.object
        rotation = nearest_equivalent(goal.rotation, self._reference(here), self._yaw_fold)
        place = goal.position.copy()
        place[:2] += self._aside()
        if self._hold is None:  # fixed from here on: with every overshoot it would climb
            self._hold = max(self._top, float(goal.position[2]) + rule.lowering)
        if self._lowering is None:
            self._aligning += 1
            slack = 2.0 if self._aligning > rule.patience else 1.0
            if (
                np.linalg.norm(here.position[:2] - place[:2]) > slack * rule.aligned
                or angle_between(here.rotation, rotation) > slack * rule.aligned_rotation
                or moved > slack * rule.resting
            ):
                return Command(Pose(np.array([*place[:2], self._hold]), rotation), "align")
            self._lowering = now
            self._still = 0
        slipped = np.linalg.norm(now.grip_point - self._lowering.grip_point) > rule.slip
        if slipped or self._still >= rule.stuck_steps:
            self._attempt += 1
            self._lowering = None
            self._aligning = 0
            self._hold = float(here.position[2]) + rule.unstick_lift
            return self._come_free(here)
        place[2] = max(place[2] - rule.press, here.position[2] - rule.lower_step)
        return Command(Pose(place, rotation), "lower")

    def _trace(self, here: Pose, target: Pose) -> Command:
        """Go where the plan leads; an object that stays wedged comes free and tries beside that."""
        self._track.append(here)
        wedged = len(self._track) == _WEDGED_STEPS and self._motion(self._track[0], here) < _WEDGED
        if wedged:
            self._attempt += 1
            self._track.clear()
            return self._come_free(here)
        if self._closing_in:
            target = target._replace(position=target.position + np.append(self._aside(), 0.0))
        return Command(target, "transit")

    @staticmethod
    def _motion(before: Pose, after: Pose) -> float:
        """Metres; a turn counts where the object would hit something with an end of it."""
        turned = angle_between(before.rotation, after.rotation)
        return float(np.linalg.norm(after.position - before.position)) + _LEVER * turned

    def _aside(self) -> np.ndarray:
        """(2,) where to try, from where the plan leads, metres."""
        ring = self._rule.search * (1 + self._attempt // len(_SEARCH))
        return ring * _SEARCH[self._attempt % len(_SEARCH)]

    def _come_free(self, here: Pose) -> Command:
        self._unstick = here.raised(self._rule.unstick_lift)
        self._unstick_steps = 0
        return Command(self._unstick, "unstick")
