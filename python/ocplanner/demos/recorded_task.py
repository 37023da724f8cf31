"""Which task an environment's recordings show, and which objects' poses they hold."""

from dataclasses import replace
from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule
from ocplanner.envs.tasks import tasks


class RecordedTask(NamedTuple):
    """Our name of a task, and its objects as the sensors are called, the main one first."""

    name: str
    objects: tuple[str, ...]


def recorded_task(env_name: str) -> RecordedTask | None:
    """What recordings of a robosuite environment show; None for one that nothing here knows.

    An environment without a layout of its flat ``object`` is known by its task: each pose is recorded by name.
    """
    layout = TASK_OBJECTS.get(env_name)
    if layout is not None:
        return RecordedTask(layout.task, layout.objects)
    for task in tasks().values():
        if task.env_name == env_name:
            return RecordedTask(task.name, tuple(spec.name for spec in task.objects))
    return None


def segment_rule(env_name: str, object_name: str) -> SegmentRule:
    """What counts as the manipulation of an object.

    Of an object that is led through each pose of a plan, the last kept pose is the one in which it is let go of: those
    after it, in which it falls, are not for a hand to lead it through.
    """
    for task in tasks().values():
        if task.env_name == env_name:
            traced = any(spec.name == object_name and spec.placing == "trace" for spec in task.objects)
            return replace(DEFAULT_RULE, after=0) if traced else DEFAULT_RULE
    return DEFAULT_RULE


def carriers(env_name: str, object_name: str) -> tuple[int, ...]:
    """Numbers of the arms that carry an object, in order; the first arm where nothing here knows better."""
    for task in tasks().values():
        for spec in task.objects:
            if (task.env_name, spec.name) == (env_name, object_name):
                return spec.arms
    return (0,)
