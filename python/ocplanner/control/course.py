"""What the plans say: the pose to aim at now, where they end, and how the object is turned meanwhile.

Which pose of a plan is the target, in each follow mode, is decided in ``rust/core/src/delta_pose.rs``.
"""

from collections import deque

import numpy as np

from ocplanner import _core
from ocplanner.control.arm import Reachability, Reading
from ocplanner.control.settings import ControlSettings, FollowSettings
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between, mean_rotation
from ocplanner.geometry.symmetry import equivalents, nearest_equivalent


class Course:
    """The plan in force, followed loosely: its next pose once the object is near the one before.

    Args:
        settings: how plans are followed.
        rule: the follower's numbers for this object.
        carried: (3, 3) rotation of the object where a plan has none.

    Attributes:
        top: greatest height of the plan in force, world, metres; -inf before the first.
        exact: whether the object is to follow the plan pose by pose.
    """

    exact = False

    def __init__(self, settings: ControlSettings, rule: FollowSettings, carried: np.ndarray) -> None:
        self.top = -np.inf
        self._carried, self._plans_rotation = carried, True
        self._controller = _core.DeltaPoseController(
            settings.follow, gate_position=rule.gate_position, gate_rotation=rule.gate_rotation
        )

    def set_plan(self, positions: np.ndarray, rotations: np.ndarray | None, here: Pose) -> Pose:
        """Take a plan, (H, 3) and (H, 3, 3) or None; returns its last pose."""
        self._controller.set_plan(positions, rotations, here)
        self.top = float(np.max(positions[:, 2]))
        self._plans_rotation = rotations is not None
        return Pose(positions[-1], self._carried if rotations is None else rotations[-1])

    def target(self, here: Pose, moved: float) -> Pose:  # noqa: ARG002
        """Advance along the plan; the pose to aim the object at, which has moved so far in the last step."""
        target = Pose(*self._controller.target(here))
        return target if self._plans_rotation else target._replace(rotation=self._carried)


class TracedCourse(Course):
    """The plan in force, followed pose by pose once it is short: each pose is the target until the object rests."""

    def __init__(self, settings: ControlSettings, rule: FollowSettings, carried: np.ndarray) -> None:
        super().__init__(settings, rule, carried)
        self._rule = rule
        self._exact_controller = _core.DeltaPoseController(
            settings.follow, gate_position=rule.aligned, gate_rotation=rule.aligned_rotation
        )
        self._aim: Pose | None = None

    def set_plan(self, positions: np.ndarray, rotations: np.ndarray | None, here: Pose) -> Pose:
        """Take a plan, (H, 3) and (H, 3, 3) or None; returns its last pose."""
        self._exact_controller.set_plan(positions, rotations, here)
        farthest = np.linalg.norm(positions - here.position, axis=1).max()
        self.exact = bool(farthest < self._rule.closing_in)
        return super().set_plan(positions, rotations, here)

    def target(self, here: Pose, moved: float) -> Pose:
        """The pose to aim the object at; an exact one stays until the object has moved less than ``resting``."""
        if not self.exact:
            self._aim = None
            return super().target(here, moved)
        if self._aim is None or moved < self._rule.resting:
            self._aim = Pose(*self._exact_controller.target(here))
        return self._aim


class PlanEnds:
    """Where the last plans ended; those that let the object down make up the goal.

    Args:
        rule: how many ends are kept, and how they are put together.
        yaw_fold: symmetry of the goal, see :class:`ocplanner.envs.tasks.ObjectSpec`.
    """

    def __init__(self, rule: FollowSettings, yaw_fold: int) -> None:
        self._rule, self._yaw_fold = rule, yaw_fold
        self._recent: deque[Pose] = deque(maxlen=rule.recent_plans)
        self._lowering: deque[Pose] = deque(maxlen=rule.goal_memory)

    def add(self, end: Pose) -> None:
        """Note where a plan ends."""
        self._recent.append(end)

    def add_goal(self, end: Pose) -> None:
        """Note where a plan lets the object down."""
        self._lowering.append(end)

    def forget_goal(self) -> None:
        """Note that a plan does not let the object down: the oldest that does no longer counts."""
        if self._lowering:
            self._lowering.popleft()

    @property
    def goal(self) -> Pose | None:
        """Where the plans let the object down: the middle of their last ends; None while they do not."""
        if not self._lowering:
            return None
        ends = np.array([end.position for end in self._lowering])
        position = np.append(np.median(ends[:, :2], axis=0), np.quantile(ends[:, 2], self._rule.depth))
        reference = self._lowering[-1].rotation
        near = [nearest_equivalent(end.rotation, reference, self._yaw_fold) for end in self._lowering]
        return Pose(position, mean_rotation(np.array(near)))

    def farthest(self, here: Pose) -> float:
        """Distance to the farthest of the last ends, metres; infinite before there are ``recent_plans`` of them."""
        if len(self._recent) < self._rule.recent_plans:
            return np.inf
        return max(float(np.linalg.norm(end.position - here.position)) for end in self._recent)

    def widest(self, here: Pose) -> float:
        """Largest angle to one of the last ends, radians."""
        return max(angle_between(end.rotation, here.rotation) for end in self._recent)


class SymmetryChoice:
    """Which of the rotations that serve the goal equally well the object is turned to.

    It is the one nearest to the object's own, unless the arm does not reach the plan's end with it; then the nearest
    with which it does. Such a choice is kept, or the object would turn back halfway.

    Args:
        rule: ``reach`` is the error that counts as not reaching.
        yaw_fold: symmetry of the goal, see :class:`ocplanner.envs.tasks.ObjectSpec`.
        reach: where the arm gets to; None: everywhere.
    """

    def __init__(self, rule: FollowSettings, yaw_fold: int, reach: Reachability | None) -> None:
        self._rule, self._yaw_fold, self._reach = rule, yaw_fold, reach
        self._chosen: np.ndarray | None = None

    def nearest(self, rotation: np.ndarray, here: Pose) -> np.ndarray:
        """The rotation (3, 3) equivalent to one that is nearest to the choice, or to the object's own without one."""
        return nearest_equivalent(rotation, self._reference(here), self._yaw_fold)

    def turn(self, positions: np.ndarray, rotations: np.ndarray, now: Reading) -> np.ndarray:
        """The rotations (H, 3, 3) of a plan, all turned alike: no jumps within a plan.

        Args:
            positions: (H, 3) of the plan, world, metres.
            rotations: (H, 3, 3) of the plan.
            now: what is sensed.
        """
        nearest, *others = equivalents(rotations[0], self._reference(now.object), self._yaw_fold)
        turned = rotations @ (rotations[0].T @ nearest)
        if self._reach is None:
            return turned
        least = self._reach_error(self._reach, positions, turned, now)
        for other in others:
            if least < self._rule.reach:
                break
            candidate = rotations @ (rotations[0].T @ other)
            error = self._reach_error(self._reach, positions, candidate, now)
            if error < least - self._rule.reach:
                least, turned, self._chosen = error, candidate, other
        if self._chosen is not None:
            self._chosen = turned[0]
        return turned

    def _reference(self, here: Pose) -> np.ndarray:
        return here.rotation if self._chosen is None else self._chosen

    @staticmethod
    def _reach_error(reach: Reachability, positions: np.ndarray, rotations: np.ndarray, now: Reading) -> float:
        """Of the hand at the plan's end, metres: it moves rigidly with the object."""
        motion = Pose(positions[-1], rotations[-1]) @ now.object.inverse()
        return reach.reach_error(motion @ now.eef)
