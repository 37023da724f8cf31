"""Actions in other units than OSC_POSE's: learned scaled to [-1, 1], and given back in their own units."""

from collections.abc import Sequence

import numpy as np

ActionRange = tuple[tuple[float, float], ...]
"""(least, most) of each number of an action."""


def range_of(actions: Sequence[np.ndarray]) -> ActionRange | None:
    """The range of recorded actions, arrays of (T, A); None if all lie in [-1, 1] and need no scaling.

    A number that never changes gets a range of its own width around it, so that it is learned as 0.
    """
    least = np.min([part.min(axis=0) for part in actions], axis=0).astype(np.float64)
    most = np.max([part.max(axis=0) for part in actions], axis=0).astype(np.float64)
    if max(-least.min(), most.max()) <= 1 + _ROUNDING:
        return None
    constant = most - least < _ROUNDING
    least, most = np.where(constant, least - 1, least), np.where(constant, most + 1, most)
    return tuple(zip(least.tolist(), most.tolist()))


def scaled(actions: np.ndarray, ranges: ActionRange | None) -> np.ndarray:
    """(T, A) actions in their own units as float32 ones, in [-1, 1] where they lie in the range."""
    if ranges is None:
        return actions.astype(np.float32)
    least, most = np.array(ranges).T
    return ((2 * actions - least - most) / (most - least)).astype(np.float32)


def unscaled(actions: np.ndarray, ranges: ActionRange | None) -> np.ndarray:
    """The inverse of :func:`scaled`."""
    if ranges is None:
        return actions
    least, most = np.array(ranges).T
    return ((least + most + actions * (most - least)) / 2).astype(np.float32)


_ROUNDING = 1e-5
