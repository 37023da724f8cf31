"""The scripted experts: one module each, found by being here, each binding ``EXPERT``.

They know where the goal is, and solve a task the way people demonstrated it.
"""

import importlib
import pkgutil
from functools import cache

from ocplanner.collection.experts.expert import Expert
from ocplanner.errors import UnknownNameError

__all__ = ["Expert", "expert_of", "experts"]


@cache
def experts() -> dict[str, Expert]:
    """All experts by the name of their task."""
    found = (importlib.import_module(f"{__name__}.{module.name}") for module in pkgutil.iter_modules(__path__))
    return {module.EXPERT.task: module.EXPERT for module in found if hasattr(module, "EXPERT")}


def expert_of(task: str) -> Expert:
    """The expert for a task.

    Raises:
        UnknownNameError: there is none.
    """
    known = experts()
    if task not in known:
        raise UnknownNameError("task with a scripted expert", task, known)
    return known[task]
