"""Whether the plan's reward puts good behaviour above bad, for every form; and its terms along both, as a figure.

``python tests/benchmarks/reward_order.py --data square_ph.hdf5 --planner square_masked_h20_pose_0.safetensors``

Good are human demonstrations that the planner was not trained on (``mask/valid``) and successes of the scripted
expert; bad are the expert that lets go on the way, the one that puts the nut down beside the peg, a hand that moves the
nut about at random and one that keeps it where it is. The area under the curve (AUC) is the chance that a good episode
scores above a bad one, ties counted half; an episode's score is its return or its mean reward while the nut is held.
The correlation is Spearman's, over all held steps, of the reward with how much nearer to the peg the nut is 10 steps
later. The planner must be one of poses.
"""

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from behaviours import BEHAVIOURS, Episode, Recorder, play, replay
from matplotlib.figure import Figure
from scipy.stats import rankdata, spearmanr

from ocplanner.demos.dataset import Demonstrations
from ocplanner.drawing.style import SERIES, new_figure, save_figure, styled
from ocplanner.envs import make_env
from ocplanner.files.storage import atomic_json
from ocplanner.guidance.rewards import Form, RewardConfig, plan_reward
from ocplanner.planner.planner import Planner
from ocplanner.versions import installed

GOOD = ("human", "expert")
FIRST_SEED = 40000
EVEN = {"a": 1 / 0.02**2, "b": 1 / 0.2**2, "scale": 1.0}
"""Weights under which 2 cm count as much as 0.2 rad, see :class:`ocplanner.RewardConfig`."""

Episodes = dict[str, list[Episode]]


def record(data: Path, planner: Planner, count: int, first_seed: int = FIRST_SEED) -> Episodes:
    """``count`` episodes of each behaviour; experts that fail and failures that succeed are left out."""
    found: Episodes = {}
    with Demonstrations(data) as demos, make_env("Square", "Panda", cameras=()) as env:
        recorder = Recorder(env, planner)
        found["human"] = [replay(recorder, demos[name]) for name in demos.mask("valid")[:count]]
        for behaviour in BEHAVIOURS:
            played = [play(recorder, behaviour, first_seed + i) for i in range(count)]
            wanted = behaviour in GOOD
            found[behaviour] = [one for one in played if one.success == wanted and one.held.any()]
    return found


def scores(episodes: Sequence[Episode], config: RewardConfig) -> dict[str, np.ndarray]:
    """(n,) return and mean reward while held, of each episode."""
    rewards = [_reward(one, config) for one in episodes]
    held = [float(reward[one.held].mean()) for reward, one in zip(rewards, episodes)]
    return {"return": np.array([float(reward.sum()) for reward in rewards]), "mean while held": np.array(held)}


def area(good: np.ndarray, bad: np.ndarray) -> float:
    """The chance that a good score is above a bad one, ties counted half."""
    ranks = rankdata(np.concatenate([good, bad]))[: len(good)]
    return float((ranks.sum() - len(good) * (len(good) + 1) / 2) / (len(good) * len(bad)))


def interval(good: np.ndarray, bad: np.ndarray, draws: int = 1000) -> tuple[float, float]:
    """95 % bootstrap interval of :func:`area`, episodes drawn with replacement."""
    rng = np.random.default_rng(0)
    areas = [area(rng.choice(good, len(good)), rng.choice(bad, len(bad))) for _ in range(draws)]
    low, high = np.quantile(areas, [0.025, 0.975])
    return float(low), float(high)


def progress_correlation(episodes: Episodes, config: RewardConfig) -> float:
    """Spearman's, of rewards and later progress over all held steps of all episodes."""
    every = [one for group in episodes.values() for one in group]
    rewards = np.concatenate([_reward(one, config)[one.held] for one in every])
    return float(spearmanr(rewards, np.concatenate([one.nearer[one.held] for one in every])).statistic)


def orders(episodes: Episodes, weights: dict[str, float]) -> dict[str, Any]:
    """For every form the correlation with progress, and the AUC of all that is good against each bad behaviour."""
    found: dict[str, Any] = {}
    good = [one for name in GOOD for one in episodes[name]]
    for form in get_args(Form):
        config = RewardConfig(form=form, **weights)  # type: ignore[arg-type]
        above, areas = scores(good, config), {}
        for name in episodes:
            if name in GOOD:
                continue
            below = scores(episodes[name], config)
            areas[name] = {
                score: {"auc": area(above[score], below[score]), "interval": interval(above[score], below[score])}
                for score in above
            }
        found[form] = {"progress_correlation": progress_correlation(episodes, config), "auc": areas}
    return found


def figure(episodes: Episodes) -> Figure:
    """Position and rotation term of each behaviour along the time in which the nut is held."""
    with styled():
        drawn = new_figure(8.0, 5.6)
        axes = drawn.subplots(2, 1, sharex=True)
        for color, (name, group) in zip(SERIES, episodes.items()):
            for term, row in enumerate(axes):
                curves = [_terms(one)[term][one.held] for one in group]
                even = np.linspace(0, 1, 50)
                along = [np.interp(even, np.linspace(0, 1, len(curve)), curve) for curve in curves]
                low, middle, high = np.quantile(along, [0.25, 0.5, 0.75], axis=0)
                row.plot(even, middle, color=color, label=f"{name} ({len(group)})", ls="-" if name in GOOD else "--")
                row.fill_between(even, low, high, color=color, alpha=0.12, lw=0)
        for row, title, unit in zip(axes, ("(a) Position term", "(b) Rotation term"), ("distance (mm)", "distance")):
            row.set(title=title, ylabel=unit, yscale="log")
        axes[0].legend(ncols=2, fontsize=8)
        axes[1].set(xlabel="share of the time in which the nut is held")
        return drawn


def main() -> None:
    """Record, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--planner", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("results/reward_order.json"))
    parser.add_argument("--figure", type=Path, default=Path("docs/images/reward_terms.png"))
    options = parser.parse_args()
    planner = Planner.load(options.planner)
    episodes = record(options.data, planner, options.episodes)
    result = {
        "command": shlex.join(["python", *sys.argv]),
        "planner_sha256": planner.sha256,
        "first_seed": FIRST_SEED,
        "episodes": {name: len(group) for name, group in episodes.items()},
        "medians_while_held": {name: _medians(group) for name, group in episodes.items()},
        "default_weights": orders(episodes, {}),
        "even_weights": {"weights": EVEN, **orders(episodes, EVEN)},
        "versions": installed(),
    }
    atomic_json(options.out, result)
    save_figure(figure(episodes), options.figure)
    for weights in ("default_weights", "even_weights"):
        for form in get_args(Form):
            row = result[weights][form]
            areas = {
                name: {score: round(value["auc"], 2) for score, value in entry.items()}
                for name, entry in row["auc"].items()
            }
            print(f"{weights} {form:9} {row['progress_correlation']:+.2f} {json.dumps(areas)}")  # noqa: T201


def _reward(episode: Episode, config: RewardConfig) -> np.ndarray:
    return plan_reward(episode.planned, episode.achieved, episode.held, config).reward


def _terms(episode: Episode) -> tuple[np.ndarray, np.ndarray]:
    """Square roots of the terms: mm, and the rotation's distance."""
    terms = plan_reward(episode.planned, episode.achieved, episode.held)
    return 1000 * np.sqrt(terms.position), np.sqrt(terms.rotation if terms.rotation is not None else terms.position)


def _medians(episodes: Sequence[Episode]) -> dict[str, float]:
    position, rotation = (np.concatenate([_terms(one)[term][one.held] for one in episodes]) for term in (0, 1))
    return {"position_mm": float(np.median(position)), "rotation": float(np.median(rotation))}


if __name__ == "__main__":
    main()
