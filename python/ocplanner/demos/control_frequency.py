"""How many control steps a second a data set was recorded with."""

import numpy as np

from ocplanner.demos.dataset import Demonstrations
from ocplanner.envs import CONTROL_HZ
from ocplanner.errors import DatasetError, MismatchError

_SAME = 0.05
"""Largest relative difference of two frequencies that count as the same."""


def control_frequency(demos: Demonstrations, name: str) -> float:
    """Control steps a second, Hz, from ``control_freq`` in env_args and the times in the states, which must agree.

    Without either it is 20, robosuite's own.

    Args:
        demos: the data set.
        name: of the demonstration whose states are looked at.

    Raises:
        MismatchError: they do not agree, or env_args hold no frequency that can be.
    """
    said = demos.env_kwargs.get("control_freq")
    if said is not None and (isinstance(said, bool) or not isinstance(said, int | float) or not said > 0):
        raise MismatchError(f"{demos.path}: control_freq in env_args is {said!r}, expected a number of Hz; correct it")
    measured = _measured(demos, name)
    if said is not None and measured is not None and abs(measured / said - 1) > _SAME:
        raise MismatchError(
            f"{demos.path}: control_freq in env_args is {said:g} Hz, but the states of {name} are {1000 / measured:g} "
            f"ms apart ({measured:.4g} Hz): steps were left out, or env_args are another recording's; correct "
            "control_freq, or give the recording with all of its steps"
        )
    return float(said or (CONTROL_HZ if measured is None else round(measured, 3)))


def _measured(demos: Demonstrations, name: str) -> float | None:
    """By the median step of the states' clock; None without a clock, as in the states of other robots."""
    if not demos.env_name:
        return None
    try:
        steps = np.diff(demos[name].states[:, 0])
    except DatasetError:
        return None
    return float(1 / np.median(steps)) if len(steps) and np.all(steps > 0) else None
