"""The tasks: one module each. A module in this package that binds ``TASK`` is found automatically."""

import importlib
import pkgutil
from functools import cache

from ocplanner.envs.tasks.task import GraspFrame, ObjectSpec, Task
from ocplanner.errors import UnknownNameError

__all__ = ["GraspFrame", "ObjectSpec", "Task", "task", "task_of_env", "tasks"]


@cache
def tasks() -> dict[str, Task]:
    """All tasks by name."""
    found = (importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__))
    return {module.TASK.name: module.TASK for module in found if hasattr(module, "TASK")}


def task(name: str) -> Task:
    """The task called ``name``, such as ``"Square"``.

    Raises:
        UnknownNameError: there is none.
    """
    known = tasks()
    if name not in known:
        raise UnknownNameError("task", name, known)
    return known[name]


def task_of_env(env_name: str) -> Task:
    """The task with robosuite's environment ``env_name``, such as ``"NutAssemblySquare"``.

    Raises:
        UnknownNameError: no task uses that environment.
    """
    known = {candidate.env_name: candidate for candidate in tasks().values()}
    if env_name not in known:
        raise UnknownNameError("robosuite environment", env_name, known)
    return known[env_name]
