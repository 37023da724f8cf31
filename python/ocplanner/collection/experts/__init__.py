"""The scripted experts: one module a task. A module in this package that binds ``EXPERT`` is found automatically.

An expert knows where the goal is, and solves its task the way people demonstrated it.
"""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ocplanner.collection.arm_programs import NoisyArmProgram
from ocplanner.collection.carrying import DemonstrationVariation
from ocplanner.envs.environment import ManipulationEnv
from ocplanner.errors import UnknownNameError


@dataclass(frozen=True)
class Expert:
    """Solves one task.

    Attributes:
        task: the task's name.
        draw_variation: draws how the next demonstration differs from others.
        solve: moves the arms. Success is the environment's to judge. It raises
            :class:`ocplanner.collection.carrying.ObjectLostError` or
            :class:`ocplanner.control.arm_program.HorizonReached` if it cannot go on.
    """

    task: str
    draw_variation: Callable[[np.random.Generator], DemonstrationVariation]
    solve: Callable[[ManipulationEnv, NoisyArmProgram, DemonstrationVariation], None]


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
