"""The algorithms that train a policy: one line each here; the rest of an algorithm lies in its own modules."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ocplanner.errors import UnknownNameError

if TYPE_CHECKING:
    from lightning_fabric import Fabric

    from ocplanner.policies.config import ObservationKind, PolicyTraining, Preset
    from ocplanner.policies.learner import Learner
    from ocplanner.policies.network import PolicyNetwork

ALGORITHMS = {
    "bc": "ocplanner.policies.bc",
    "bc-rnn": "ocplanner.policies.bc_rnn",
    "bcq": "ocplanner.policies.bcq",
}
"""Algorithm -> the module that binds its :class:`Algorithm` to the name ``ALGORITHM``."""


@dataclass(frozen=True)
class AlgorithmSettings:
    """Settings that one algorithm alone has. Most have none."""


@dataclass(frozen=True)
class Algorithm:
    """What training, acting and the command line need to know of an algorithm.

    Attributes:
        network: makes its network from the settings, the width of the low-dimensional observation and that of actions.
        learner: makes what trains such a network.
        preset: its settings by the preset's name and the kind of observation.
        settings: class of ``PolicyTraining.algorithm_settings``.
        sequences: it learns from sequences of ``network.sequence`` steps instead of single steps.
        rewards: it learns from rewards, and so needs what follows each step.
        hints: it can read the plan as a hint.
        bfloat16: it can train with products in bfloat16.
    """

    network: Callable[["PolicyTraining", int, int], "PolicyNetwork"]
    learner: Callable[["Fabric", "PolicyTraining", Any], "Learner"]
    preset: Callable[["Preset", "ObservationKind"], "PolicyTraining"]
    settings: type[AlgorithmSettings] = AlgorithmSettings
    sequences: bool = False
    rewards: bool = False
    hints: bool = True
    bfloat16: bool = True


def find_algorithm(name: str) -> Algorithm:
    """The algorithm of this name.

    Raises:
        UnknownNameError: there is none; the message lists the known ones.
    """
    if name not in ALGORITHMS:
        raise UnknownNameError("algorithm", name, ALGORITHMS)
    return importlib.import_module(ALGORITHMS[name]).ALGORITHM
