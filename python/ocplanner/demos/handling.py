"""Which arm handles which object when: of every object of a task the segment, and who holds it."""

from typing import NamedTuple

import numpy as np

from ocplanner.demos.demonstration import Demonstration
from ocplanner.demos.segments import DEFAULT_RULE, Segment, SegmentRule, manipulation_segment
from ocplanner.envs.tasks import ObjectSpec, Task
from ocplanner.holding import held_steps

NOBODY = -1


class Handling(NamedTuple):
    """How one object of a demonstration is handled.

    Attributes:
        name: the object's.
        segment: from the first arm's grasp to the last one's release.
        holder: (T,) number of the arm that holds it before the action of that step, of two the one that gives it;
            :data:`NOBODY` where none does.
    """

    name: str
    segment: Segment
    holder: np.ndarray

    @property
    def arms(self) -> tuple[int, ...]:
        """The arms that held it, in the order in which they did."""
        held = self.holder[self.holder != NOBODY]
        turns = np.flatnonzero(np.diff(held, prepend=NOBODY))
        return tuple(int(arm) for arm in held[turns])


def handlings(demo: Demonstration, task: Task, rule: SegmentRule = DEFAULT_RULE) -> tuple[Handling, ...]:
    """How each object of a task is handled in a demonstration, in the task's order.

    Raises:
        DatasetError: an object is never manipulated, or an array is missing or damaged.
        ObjectLayoutError: an object's pose cannot be told.
    """
    return tuple(_handling(demo, spec, rule) for spec in task.objects)


def _handling(demo: Demonstration, spec: ObjectSpec, rule: SegmentRule) -> Handling:
    positions, rotations = demo.object_poses(spec.name)
    segment = manipulation_segment(positions, rotations, demo.gripper_actions(spec.arms), rule)
    holder = np.full(len(positions), NOBODY)
    for arm in reversed(spec.arms):
        held = held_steps(positions, rotations, demo.hand_positions(arm), demo.gripper_actions((arm,)))
        holder[held] = arm
    return Handling(spec.name, segment, holder)
