"""Object-centric planning: learn the object's trajectory from one robot, follow it with another.

>>> import ocplanner as ocp
>>> demos = ocp.Demonstrations("square_ph.hdf5")          # doctest: +SKIP
>>> planner = ocp.Planner.load("planner.safetensors")     # doctest: +SKIP
>>> result = ocp.transfer(planner, robot="Sawyer")        # doctest: +SKIP
"""

import importlib
import os
import sys
from typing import TYPE_CHECKING, Any

from ocplanner.envs.registration import register
from ocplanner.versions import check_pins

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # must be set before mujoco is imported

check_pins()
register()

if TYPE_CHECKING:
    from ocplanner import transfer
    from ocplanner.demos.dataset import Demonstrations
    from ocplanner.demos.demonstration import Demonstration
    from ocplanner.envs import make_env
    from ocplanner.planner.planner import Plan, Planner
    from ocplanner.policies.evaluate import evaluate_policy
    from ocplanner.policies.policy import Policy
    from ocplanner.policies.result import PolicyResult
    from ocplanner.pose import Pose
    from ocplanner.rewards import LabelSettings, RewardConfig, label_dataset, label_demonstration, plan_reward

_LAZY = {
    "Demonstration": "ocplanner.demos.demonstration",
    "Demonstrations": "ocplanner.demos.dataset",
    "LabelSettings": "ocplanner.rewards",
    "Plan": "ocplanner.planner.planner",
    "Planner": "ocplanner.planner.planner",
    "Policy": "ocplanner.policies.policy",
    "PolicyResult": "ocplanner.policies.result",
    "Pose": "ocplanner.pose",
    "RewardConfig": "ocplanner.rewards",
    "evaluate_policy": "ocplanner.policies.evaluate",
    "label_dataset": "ocplanner.rewards",
    "label_demonstration": "ocplanner.rewards",
    "make_env": "ocplanner.envs",
    "plan_reward": "ocplanner.rewards",
}

__all__ = [
    "Demonstration",
    "Demonstrations",
    "LabelSettings",
    "Plan",
    "Planner",
    "Policy",
    "PolicyResult",
    "Pose",
    "RewardConfig",
    "evaluate_policy",
    "label_dataset",
    "label_demonstration",
    "make_env",
    "plan_reward",
    "transfer",
]


def __getattr__(name: str) -> Any:
    """Import the public names on first use: ``import ocplanner`` alone loads neither torch nor robosuite."""
    if name == "transfer":
        return importlib.import_module("ocplanner.transfer")
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'ocplanner' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
