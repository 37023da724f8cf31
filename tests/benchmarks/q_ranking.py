"""After how many training steps BCQ's critics put episodes that succeed above episodes that fail, run by run.

``ocplanner collect --out successes.hdf5 --episodes 20 --seed 9``, the same with ``--flaw early-release`` and
``--flaw misjudged-goal`` for failures; for policies that see pictures ``ocplanner render`` adds them. Then
``python tests/benchmarks/q_ranking.py runs/bcq_0 ... --successes successes.hdf5 --failures early.hdf5 beside.hdf5``.

Both kinds of episodes are the scripted expert's, from the same seeds; no policy was trained on them. An episode's score
is the first critic's value of the recorded actions, averaged over the whole episode, or over its last second. The area
under the curve (AUC) is the chance that a success scores above a failure. A run ranks them from the first of its kept
policies after which the AUC stays at 0.9 or more.
"""

import argparse
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from reward_order import area, interval

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import SERIES, new_figure, save_figure, styled
from ocplanner.files.storage import atomic_json
from ocplanner.policies.converted_episode import load_episode
from ocplanner.policies.data import Samples
from ocplanner.policies.evaluate import checkpoints
from ocplanner.policies.policy import Policy
from ocplanner.policies.q_values import values_of
from ocplanner.versions import installed

RANKED = 0.9
_LAST_SECOND = 20  # steps
SCORES = ("whole episode", "last second")


def episodes(policy: Policy, path: Path) -> list[Samples]:
    """Every episode of a file, as the policy and all others of its training see it."""
    with Demonstrations(path) as demos:
        return [load_episode(policy, demos, name) for name in demos.names]


def scores(policy: Policy, recorded: Sequence[Samples]) -> np.ndarray:
    """(2, N): of every episode its mean value, as a whole and in its last second."""
    values = [values_of(policy, samples)[0] for samples in recorded]
    return np.array([[value.mean() for value in values], [value[-_LAST_SECOND:].mean() for value in values]])


def ranking(policy: Policy, successes: Sequence[Samples], failures: Mapping[str, Sequence[Samples]]) -> dict[str, Any]:
    """AUC of successes against each kind of failure, by both scores, with bootstrap intervals."""
    good = scores(policy, successes)
    found: dict[str, Any] = {}
    for kind, recorded in failures.items():
        pairs = zip(SCORES, good, scores(policy, recorded))
        found[kind] = {name: {"auc": area(*pair), "interval": interval(*pair)} for name, *pair in pairs}
    return found


def ranked_from(steps: Sequence[int], areas: Sequence[float]) -> int | None:
    """The first step from which on every area is at least 0.9; None if there is none."""
    below = [index for index, value in enumerate(areas) if value < RANKED]
    first = below[-1] + 1 if below else 0
    return steps[first] if first < len(steps) else None


def follow(run: Path, successes: Path, failures: Sequence[Path]) -> dict[str, Any]:
    """The ranking of every policy that a run kept."""
    policies = [Policy.load(path) for path in checkpoints(run)]
    steps = [policy.header.step for policy in policies]
    good, bad = episodes(policies[0], successes), {path.stem: episodes(policies[0], path) for path in failures}
    kept = [ranking(policy, good, bad) for policy in policies]
    first = {
        kind: {score: ranked_from(steps, [one[kind][score]["auc"] for one in kept]) for score in SCORES} for kind in bad
    }
    return {"run": run.name, "steps": steps, "rankings": kept, "ranked_from": first}


def figure(rows: Sequence[dict[str, Any]]) -> Figure:
    """AUC along the training, one panel a kind of failure; solid by the whole episode, dashed by the last second.

    Runs whose names differ only in what follows the last underscore, the seed, have one colour.
    """
    kinds = list(rows[0]["ranked_from"])
    groups = list(dict.fromkeys(_group(row) for row in rows))
    with styled():
        drawn = new_figure(4.0 * len(kinds), 3.2)
        panels = np.atleast_1d(drawn.subplots(1, len(kinds), sharey=True))
        for panel, kind in zip(panels, kinds):
            for row in rows:
                color = SERIES[groups.index(_group(row))]
                for score, style in zip(SCORES, ("-", "--")):
                    areas = [one[kind][score]["auc"] for one in row["rankings"]]
                    panel.plot(row["steps"], areas, style, color=color)
            panel.axhline(0.5, color="0.6", lw=0.8)
            panel.set(title=f"success above {kind}", xlabel="training step", ylim=(-0.02, 1.02))
        panels[0].set(ylabel="AUC")
        shown = [Line2D([], [], color=color, label=group) for color, group in zip(SERIES, groups)]
        panels[0].legend(handles=shown, fontsize=8)
        return drawn


def _group(row: dict[str, Any]) -> str:
    return str(row["run"]).rpartition("_")[0] or str(row["run"])


def main() -> None:
    """Measure, print from when on each run ranks, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", help="run folders of BCQ")
    parser.add_argument("--successes", type=Path, required=True)
    parser.add_argument("--failures", type=Path, nargs="+", required=True)
    parser.add_argument("--out", type=Path, default=Path("results/q_ranking.json"))
    parser.add_argument("--figure", type=Path, default=Path("docs/images/q_ranking.png"))
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for run in options.runs:
        rows.append(follow(run, options.successes, options.failures))
        print(rows[-1]["run"], rows[-1]["ranked_from"], flush=True)  # noqa: T201
    command = shlex.join(["python", "tests/benchmarks/q_ranking.py", *sys.argv[1:]])
    atomic_json(options.out, {"command": command, "versions": installed(), "ranked": RANKED, "runs": rows})
    save_figure(figure(rows), options.figure)


if __name__ == "__main__":
    main()
