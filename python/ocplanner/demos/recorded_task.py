"""Which task an environment's recordings show, and which objects' poses they hold."""

from dataclasses import replace
from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
from ocplanner.demos.segments import DEFAULT_RULE, SegmentRule
from ocplanner.envs.tasks import ObjectSpec, Task, task_of_env
from ocplanner.errors import UnknownNameError


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
    task = _task(env_name)
    return None if task is None else RecordedTask(task.name, tuple(spec.name for spec in task.objects))


def segment_rule(env_name: str, object_name: str) -> SegmentRule:
    """What counts as the manipulation of an object.

    Of an object that is led through each pose of a plan, the last kept pose is the one in which it is let go of: those
    after it, in which it falls, are not for a hand to lead it through.
    """
    spec = _object(env_name, object_name)
    return replace(DEFAULT_RULE, after=0) if spec is not None and spec.placing == "trace" else DEFAULT_RULE


def carriers(env_name: str, object_name: str) -> tuple[int, ...]:
    """Numbers of the arms that carry an object, in order; the first arm where nothing here knows better."""
    spec = _object(env_name, object_name)
    return (0,) if spec is None else spec.arms


def _task(env_name: str) -> Task | None:
    try:
        return task_of_env(env_name)
    except UnknownNameError:
        return None


def _object(env_name: str, object_name: str) -> ObjectSpec | None:
    task = _task(env_name)
    return None if task is None else next((spec for spec in task.objects if spec.name == object_name), None)
