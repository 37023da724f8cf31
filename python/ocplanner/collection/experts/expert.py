"""What a scripted expert is."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ocplanner.collection.carrying import DemonstrationVariation, NoisyArmProgram
from ocplanner.envs.environment import ManipulationEnv


@dataclass(frozen=True)
class Expert:
    """Solves one task.

    Attributes:
        task: the task's name.
        manner: draws how the next demonstration is done.
        solve: does it; success is the environment's to judge. Raises
            :class:`ocplanner.collection.carrying.ObjectLostError` or
            :class:`ocplanner.control.arm_program.HorizonReached` when it cannot go on.
    """

    task: str
    manner: Callable[[np.random.Generator], DemonstrationVariation]
    solve: Callable[[ManipulationEnv, NoisyArmProgram, DemonstrationVariation], None]
