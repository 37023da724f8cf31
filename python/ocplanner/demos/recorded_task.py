"""What recordings of an environment show: the task, its objects, and which steps count as manipulating each."""

from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule, closed_spans
from ocplanner.envs.tasks import ObjectSpec, Task, task_of_env
from ocplanner.envs.tasks.task import PART
from ocplanner.errors import UnknownNameError


class RecordedTask(NamedTuple):
    """The task that recordings show.

    Attributes:
        name: ours, such as ``Square``.
        objects: the objects' names, which are also the prefixes of their sensors; the main one first.
        parts: what planners are trained for: an object, or what one arm does with an object that several carry, see
            :attr:`ocplanner.envs.tasks.ObjectSpec.parts`.
    """

    name: str
    objects: tuple[str, ...]
    parts: tuple[str, ...]


def recorded_task(env_name: str) -> RecordedTask | None:
    """What recordings of a robosuite environment show; None for an unknown environment.

    An environment is known by the layout of its flat ``object``, or by a task, whose poses are recorded by name.
    """
    layout, task = TASK_OBJECTS.get(env_name), _task(env_name)
    specs = {} if task is None else {spec.name: spec for spec in task.objects}
    if task is not None:
        name = task.name
    elif layout is not None:
        name = layout.task
    else:
        return None
    objects = tuple(specs) if layout is None else layout.objects
    parts = (specs[name].parts if name in specs else (name,) for name in objects)
    return RecordedTask(name, objects, tuple(chain.from_iterable(parts)))


def object_of(part: str) -> str:
    """The object that a part belongs to: ``payload`` of ``payload:0``."""
    return part.partition(PART)[0]


def segment_rule(env_name: str, part: str) -> SegmentRule:
    """What counts as the manipulation of an object, or of one arm's part of it.

    If an object is led through each pose of a plan, the last kept pose is the one at the release: the object falls
    through those after it, and no hand could lead it there. The part of an arm that hands the object over ends when
    the arm holds the object still for the next one.
    """
    spec = _object(env_name, object_of(part))
    if spec is not None and part != spec.name:
        return replace(DEFAULT_RULE, at_rest=part != spec.parts[-1])
    return replace(DEFAULT_RULE, fall=0.0) if spec is not None and spec.placing == "trace" else DEFAULT_RULE


def carriers(env_name: str, part: str) -> tuple[int, ...]:
    """Numbers of the arms that carry an object, in order, or of the one arm of a part; (0,) for an unknown object."""
    spec = _object(env_name, object_of(part))
    if spec is None:
        return (0,)
    return spec.arms if part == spec.name else (spec.arms[spec.parts.index(part)],)


def part_gripper(grippers: np.ndarray, env_name: str, part: str) -> np.ndarray:
    """(T,) above 0 where a hand that carries an object closes, below 0 where it opens.

    The part of an arm that hands the object over ends when the next arm closes its hand, and that arm's part begins
    when the first one opens: what the object does between two hands is nobody's manipulation.

    Args:
        grippers: (T, arms) the actions of all grippers.
        env_name: robosuite's name of the environment.
        part: an object, or what one arm does with it (``payload:0``).
    """
    spec, arms = _object(env_name, object_of(part)), carriers(env_name, part)
    own = grippers[:, list(arms)].max(axis=1)
    if spec is None or len(arms) == len(spec.arms):
        return own
    place = spec.arms.index(arms[0])
    if place + 1 < len(spec.arms):
        taken, _ = _hand_over(own, grippers[:, spec.arms[place + 1]])
        own[taken:] = -1.0
    if place > 0:
        _, given = _hand_over(grippers[:, spec.arms[place - 1]], own)
        own[:given] = -1.0
    return own


def _hand_over(giver: np.ndarray, taker: np.ndarray) -> tuple[int, int]:
    """The step at which the taker closes on what the giver still holds, and that at which the giver opens."""
    taken = closed_spans(taker)
    for close, opened in reversed(closed_spans(giver)):
        for grasp, release in taken:
            if close < grasp < opened <= release:
                return grasp, opened
    return len(giver), 0


def _task(env_name: str) -> Task | None:
    try:
        return task_of_env(env_name)
    except UnknownNameError:
        return None


def _object(env_name: str, object_name: str) -> ObjectSpec | None:
    task = _task(env_name)
    return None if task is None else next((spec for spec in task.objects if spec.name == object_name), None)
