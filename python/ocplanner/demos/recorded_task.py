"""Which task an environment's recordings show, and which objects' poses they hold."""

from dataclasses import replace
from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule
from ocplanner.envs.tasks import ObjectSpec, Task, task_of_env
from ocplanner.envs.tasks.task import PART
from ocplanner.errors import UnknownNameError


class RecordedTask(NamedTuple):
    """Our name of a task, its objects as the sensors are called, the main one first, and their parts.

    The parts are what planners are called: an object, or what one arm does with one that several carry, see
    :attr:`ocplanner.envs.tasks.ObjectSpec.parts`.
    """

    name: str
    objects: tuple[str, ...]
    parts: tuple[str, ...]


def recorded_task(env_name: str) -> RecordedTask | None:
    """What recordings of a robosuite environment show; None for one that nothing here knows.

    An environment without a layout of its flat ``object`` is known by its task: each pose is recorded by name.
    """
    layout = TASK_OBJECTS.get(env_name)
    if layout is not None:
        return RecordedTask(layout.task, layout.objects, layout.objects)
    task = _task(env_name)
    if task is None:
        return None
    parts = tuple(part for spec in task.objects for part in spec.parts)
    return RecordedTask(task.name, tuple(spec.name for spec in task.objects), parts)


def object_of(part: str) -> str:
    """The object of which a part is handled."""
    return part.partition(PART)[0]


def segment_rule(env_name: str, part: str) -> SegmentRule:
    """What counts as the manipulation of an object, or of a part of it.

    Of an object that is led through each pose of a plan, the last kept pose is the one in which it is let go of: those
    after it, in which it falls, are not for a hand to lead it through. An arm that hands the object over has done its
    part when it holds it still for the next one.
    """
    spec = _object(env_name, object_of(part))
    if spec is not None and part in spec.parts[:-1]:
        return replace(DEFAULT_RULE, at_rest=True)
    return replace(DEFAULT_RULE, after=0) if spec is not None and spec.placing == "trace" else DEFAULT_RULE


def carriers(env_name: str, part: str) -> tuple[int, ...]:
    """Numbers of the arms that carry an object, or do a part of that, in order; the first if nothing here knows."""
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
