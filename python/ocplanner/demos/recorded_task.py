"""What recordings of an environment show: the task, its objects, and which steps count as manipulating each."""

from dataclasses import replace
from itertools import chain
from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule
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
    if spec is not None and part in spec.parts[:-1]:
        return replace(DEFAULT_RULE, at_rest=True)
    return replace(DEFAULT_RULE, after=0) if spec is not None and spec.placing == "trace" else DEFAULT_RULE


def carriers(env_name: str, part: str) -> tuple[int, ...]:
    """Numbers of the arms that carry an object, in order, or of the one arm of a part; (0,) for an unknown object."""
    spec = _object(env_name, object_of(part))
    if spec is None:
        return (0,)
    return spec.arms if part == spec.name else (spec.arms[spec.parts.index(part)],)


def _task(env_name: str) -> Task | None:
    try:
        return task_of_env(env_name)
    except UnknownNameError:
        return None


def _object(env_name: str, object_name: str) -> ObjectSpec | None:
    task = _task(env_name)
    return None if task is None else next((spec for spec in task.objects if spec.name == object_name), None)
