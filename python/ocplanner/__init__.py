"""Object-centric planning: learn the object's trajectory from one robot, follow it with another.

>>> import ocplanner as ocp
>>> demos = ocp.Demonstrations("square_ph.hdf5")          # doctest: +SKIP
>>> planner = ocp.Planner.load("planner.safetensors")     # doctest: +SKIP
>>> result = ocp.transfer(planner, robot="Sawyer")        # doctest: +SKIP

Importing the package loads neither a simulator nor torch; each public name loads what it needs on first use. If
Gymnasium is installed, the tasks are registered with it as ``ocplanner/<Task>-v0``.
"""

import importlib
import importlib.util
import os
import sys
from typing import Any

if sys.platform == "linux":
    os.environ.setdefault("MUJOCO_GL", "egl")  # must be set before mujoco is imported

if importlib.util.find_spec("gymnasium") is not None:
    importlib.import_module("ocplanner.envs.registration").register()

_LAZY = {
    "Demonstration": "ocplanner.demos.demonstration",
    "Demonstrations": "ocplanner.demos.dataset",
    "LabelSettings": "ocplanner.guidance.settings",
    "Plan": "ocplanner.planner.planner",
    "PlanReward": "ocplanner.guidance.live_reward",
    "Planner": "ocplanner.planner.planner",
    "Policy": "ocplanner.policies.policy",
    "PolicyResult": "ocplanner.files.records.evaluation",
    "Pose": "ocplanner.geometry.pose",
    "RewardConfig": "ocplanner.guidance.rewards",
    "TransferConfig": "ocplanner.zero_shot.settings",
    "evaluate_policy": "ocplanner.policies.evaluate",
    "label_dataset": "ocplanner.guidance.dataset",
    "make_env": "ocplanner.envs",
    "plan_reward": "ocplanner.guidance.rewards",
    "transfer": "ocplanner.zero_shot.transfer",
}

__all__ = list(_LAZY)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'ocplanner' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
