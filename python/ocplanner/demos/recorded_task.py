"""Which task an environment's recordings show, and which objects' poses they hold."""

from typing import NamedTuple

from ocplanner.demos.layouts import TASK_OBJECTS
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
