"""Simulated tasks: any robot on any task, with its poses, its success and its images.

Importing this package is cheap; robosuite and mujoco are imported when the first environment is made.
"""

import importlib
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ocplanner.envs.environment import ManipulationEnv, make_env

__all__ = ["ControlLoop", "ManipulationEnv", "make_env"]

ControlLoop = Literal["native", "stock"]
"""``native``: the control loop in Rust. ``stock``: robosuite's own, slower, with the same torques."""

CONTROL_HZ = 20.0
"""Control steps a second, if nothing else is said: robosuite's own choice."""
CONTROL_RANGE_HZ = (1.0, 500.0)
"""The fastest is one control step a physics step."""


def __getattr__(name: str) -> object:
    if name in ("ManipulationEnv", "make_env"):
        return getattr(importlib.import_module("ocplanner.envs.environment"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
