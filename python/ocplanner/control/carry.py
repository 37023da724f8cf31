"""An object in the hand on its way: what the follower's phases and the ways of placing share."""

from dataclasses import dataclass

import numpy as np

from ocplanner.control.course import Course, PlanEnds, SymmetryChoice
from ocplanner.control.settings import FollowSettings
from ocplanner.geometry.pose import Pose
from ocplanner.geometry.rotation import angle_between

# Places tried after wedging, in units of the search radius: the estimate itself, then a ring around it.
_RING = np.array(
    [(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
)


def motion(before: Pose, after: Pose, lever: float) -> float:
    """How far an object has moved, metres; a turn by a radian counts as ``lever`` metres."""
    moved = float(np.linalg.norm(after.position - before.position))
    return moved + lever * angle_between(before.rotation, after.rotation) if lever else moved


class Motion:
    """How the object has moved so far.

    Args:
        start: where it was taken.
        stuck: motion in a step below which it does not move, metres.
        lever: see :func:`motion`.

    Attributes:
        moved: in the last step, metres.
        still: steps in a row in which it did not move.
        top: greatest height so far, world, metres.
    """

    def __init__(self, start: Pose, stuck: float, lever: float) -> None:
        self.moved, self.still, self.top = 0.0, 0, float(start.position[2])
        self._stuck, self._lever, self._previous = stuck, lever, start

    def step(self, here: Pose) -> None:
        """Note where the object is one control step later."""
        self.moved = motion(self._previous, here, self._lever)
        self.still = self.still + 1 if self.moved < self._stuck else 0
        self.top = max(self.top, float(here.position[2]))
        self._previous = here


@dataclass
class Search:
    """Where the goal is tried: at its estimate first, then in widening rings around it.

    Attributes:
        radius: of the first ring, metres.
        attempts: tries that have failed.
        aligning: steps spent on lining the object up since the last of them.
    """

    radius: float
    attempts: int = 0
    aligning: int = 0

    def fail(self) -> None:
        """This try has failed: go on to the next place."""
        self.attempts += 1
        self.aligning = 0

    @property
    def aside(self) -> np.ndarray:
        """(2,) from the estimate to the place that is tried now, metres."""
        ring, place = divmod(self.attempts, len(_RING))
        return self.radius * (1 + ring) * _RING[place]


@dataclass
class Carry:
    """The state of one object on its way.

    Attributes:
        rule: the follower's numbers for this object.
        start: where it was taken.
        course: the plan in force.
        symmetry: how the object is turned.
        ends: where the last plans ended.
        motion: how it has moved.
        search: where the goal is tried.
        lifted: whether its first lift is over.
    """

    rule: FollowSettings
    start: Pose
    course: Course
    symmetry: SymmetryChoice
    ends: PlanEnds
    motion: Motion
    search: Search
    lifted: bool = False

    def is_lifted(self, here: Pose) -> bool:
        """Whether the first lift is over, or the object at a pose is as high as it leads."""
        return self.lifted or bool(here.position[2] > self.start.position[2] + self.rule.lift_first)

    def place_to_try(self, goal: Pose, here: Pose) -> Pose:
        """The goal, moved aside by the search and turned by its symmetry to suit the object at a pose."""
        position = goal.position.copy()
        position[:2] += self.search.aside
        return Pose(position, self.symmetry.nearest(goal.rotation, here))
