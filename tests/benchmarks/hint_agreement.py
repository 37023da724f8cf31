"""How the hints in a labelled data set agree with the recorded actions, axis by axis, while the object is held.

``python tests/benchmarks/hint_agreement.py labelled.hdf5 --mask valid``
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ocplanner.demos.dataset import Demonstrations

AXES = ("x", "y", "z", "rx", "ry", "rz")


class Agreement(NamedTuple):
    """Of one horizon step; (6,) each, one number an axis.

    Attributes:
        correlation: of hint and action; this and others are NaN for an axis on which either never changes.
        weight: the one factor on the hint that comes nearest to the action.
        explained: share of the action's sum of squares that this leaves nothing of.
        hint: mean size.
        action: mean size.
    """

    correlation: np.ndarray
    weight: np.ndarray
    explained: np.ndarray
    hint: np.ndarray
    action: np.ndarray


def agreement(hints: np.ndarray, actions: np.ndarray) -> Agreement:
    """Compare hints (N, 6) with actions (N, 6)."""
    apart_h, apart_a = hints - hints.mean(axis=0), actions - actions.mean(axis=0)
    both = np.sqrt(np.sum(apart_h**2, axis=0) * np.sum(apart_a**2, axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.sum(apart_h * apart_a, axis=0) / both
        weight = np.sum(hints * actions, axis=0) / np.sum(hints**2, axis=0)
        left = np.sum((actions - weight * hints) ** 2, axis=0) / np.sum(actions**2, axis=0)
    return Agreement(correlation, weight, 1 - left, np.abs(hints).mean(axis=0), np.abs(actions).mean(axis=0))


def agreements(path: Path, mask: str | None = None) -> dict[int, Agreement]:
    """By horizon step, over all held steps of a labelled data set."""
    with Demonstrations(path) as demos:
        steps = (demos.label_settings or {})["settings"]["horizon_steps"]
        names = demos.names if mask is None else demos.mask(mask)
        hints = np.concatenate([demos[name].observation("ocp_hint") for name in names])
        actions = np.concatenate([demos[name].actions[:, :6] for name in names])
    held = hints[:, -1] > 0
    return {k: agreement(hints[held, 6 * i : 6 * i + 6], actions[held]) for i, k in enumerate(steps)}


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--mask")
    options = parser.parse_args()
    print(f"{'k':>3} {'':12}" + "".join(f"{axis:>7}" for axis in AXES))  # noqa: T201
    for k, found in agreements(options.data, options.mask).items():
        for name, values in found._asdict().items():
            print(f"{k:>3} {name:12}" + "".join(f"{value:7.2f}" for value in values))  # noqa: T201


if __name__ == "__main__":
    main()
