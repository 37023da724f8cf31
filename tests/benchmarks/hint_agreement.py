"""How hints agree with the recorded actions, axis by axis, while the object is held.

``python tests/benchmarks/hint_agreement.py --data images.hdf5 --planner planner.safetensors``
"""

import argparse
import shlex
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from ocplanner.demos.action_frame import ActionFrame
from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.files.storage import atomic_json
from ocplanner.guidance.hints import action_law, plan_hints
from ocplanner.guidance.labels import Labeller
from ocplanner.guidance.settings import LabelSettings, Origin
from ocplanner.planner.planner import Plan, Planner
from ocplanner.versions import installed

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


class Held(NamedTuple):
    """Every step of some demonstrations at which the object is held, N in all.

    Attributes:
        actions: (N, 6) recorded.
        hints: (N, 6) by origin and k; the origin is ``object``, ``plan``, or ``recorded``: from the object to where it
            was k steps later in the recording.
    """

    actions: np.ndarray
    hints: dict[tuple[str, int], np.ndarray]


def held_hints(data: Path, planner: Planner, mask: str, steps: tuple[int, ...]) -> Held:
    """Hints for the demonstrations in a mask of a data set that has the planner's images."""
    actions, hints = list[np.ndarray](), dict[tuple[str, int], list[np.ndarray]]()
    with Demonstrations(data) as demos, ActionFrame(demos) as frame, ExitStack() as opened:
        labellers = {
            origin: opened.enter_context(Labeller(planner, demos, LabelSettings(horizon_steps=steps, hint_from=origin)))
            for origin in get_args(Origin)
        }
        for name in demos.mask(mask):
            demo = demos[name]
            rows = {origin: labeller.label(demo)["obs/ocp_hint"] for origin, labeller in labellers.items()}
            held = rows["object"][:, -1] > 0
            rows["recorded"] = np.zeros_like(rows["object"])
            rows["recorded"][held, :-1] = _towards_recorded(demo, np.flatnonzero(held), planner, frame, steps)
            actions.append(demo.actions[held, :6])
            for origin, row in rows.items():
                for index, k in enumerate(steps):
                    hints.setdefault((origin, k), []).append(row[held, 6 * index : 6 * index + 6])
    return Held(np.concatenate(actions), {key: np.concatenate(parts) for key, parts in hints.items()})


def _towards_recorded(
    demo: Demonstration, rows: np.ndarray, planner: Planner, frame: ActionFrame, steps: tuple[int, ...]
) -> np.ndarray:
    position, rotation = demo.object_poses(planner.header.object)
    later = np.minimum(rows[:, None] + np.arange(1, max(steps) + 1), demo.length - 1)
    plan = Plan(position[later], rotation[later], np.ones(len(rows)))
    here, bases = (position[rows], rotation[rows]), frame.rotations_world(demo, rows)
    return plan_hints(plan, here, demo.eef_positions[rows], bases, steps, action_law(frame.scale), "object")


def _number(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None


def main() -> None:
    """Measure, print a row for each hint, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="with the planner's images")
    parser.add_argument("--planner", type=Path, required=True)
    parser.add_argument("--mask", default="valid")
    parser.add_argument("--horizon-step", type=int, nargs="+", default=[1, 5, 10])
    parser.add_argument("--output", type=Path, default=Path("results/hint_agreement.json"))
    options = parser.parse_args()
    held = held_hints(options.data, Planner.load(options.planner), options.mask, tuple(options.horizon_step))
    rows = []
    for (origin, k), hints in held.hints.items():
        found = agreement(hints, held.actions)._asdict()
        numbers = {name: dict(zip(AXES, map(_number, values))) for name, values in found.items()}
        rows.append({"from": origin, "k": k, **numbers})
        pairs = zip(AXES, found["correlation"], found["weight"])
        told = (f"{axis} {correlation:.2f} ({weight:.1f})" for axis, correlation, weight in pairs)
        print(f"{origin}, k = {k}:", "  ".join(told))  # noqa: T201
    result = {
        "command": shlex.join(["python", "tests/benchmarks/hint_agreement.py", *sys.argv[1:]]),
        "steps held": len(held.actions),
        "versions": installed(),
        "rows": rows,
    }
    atomic_json(options.output, result)


if __name__ == "__main__":
    main()
