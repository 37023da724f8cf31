"""Untrained policies, their evaluations and a labelled data set, for tests that need them but no good ones."""

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from ocplanner.files.records.episode import EpisodeResult
from ocplanner.files.records.evaluation import CheckpointResult, EvaluationSettings, PolicyResult
from ocplanner.files.records.labels import LABEL_ATTRIBUTE, ActionScale
from ocplanner.files.records.policy import PolicyHeader
from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.config import HintConfig, NetworkConfig, ObservationConfig, PolicyTraining, preset
from ocplanner.policies.network import make_network
from ocplanner.policies.policy import save_policy
from ocplanner.policies.train import read
from ocplanner.rollouts.intervals import wilson
from ocplanner.settings import to_dict

HELD = slice(30, 70)
"""Steps at which the labelled demonstrations have a hint."""


def write_labelled(
    source: Path, path: Path, horizons: tuple[int, ...] = (5,), planner: str = "ab" * 32, held: bool = True
) -> Path:
    """A copy of a data set with random hints, as ``ocplanner label`` would leave it; not ``held``: all off."""
    shutil.copy(source, path)
    settings = {"horizon_steps": list(horizons), "hint_from": "object"}
    rng = np.random.default_rng(0)
    with h5py.File(path, "a") as file:
        file["data"].attrs[LABEL_ATTRIBUTE] = json.dumps({"planner_sha256": planner, "settings": settings})
        for demo in file["data"].values():
            hint = np.zeros((len(demo["actions"]), 6 * len(horizons) + 1), dtype=np.float32)
            span = HELD if held else slice(0)
            hint[span] = rng.uniform(-0.5, 0.5, hint[span].shape)
            hint[span, -1] = 1
            demo["obs/ocp_hint"] = hint
    return path


def random_training(
    algorithm="bc", hint: tuple[int, ...] | None = (5,), cameras: tuple[str, ...] = (), seed: int = 0
) -> PolicyTraining:
    """Settings of a tiny policy."""
    encoder = EncoderConfig(channels=(4, 8, 8), feature=8)
    network = NetworkConfig(
        hidden=(32, 32), lstm_hidden=16, sequence=7, hint=None if hint is None else HintConfig(hint)
    )
    observation = ObservationConfig(cameras=cameras, encoder=encoder)
    return replace(preset("cpu", algorithm), observation=observation, network=network, seed=seed)


def header_of(config: PolicyTraining, **changes) -> PolicyHeader:
    """What the file of a policy trained on Square PH from states says about itself."""
    square = {
        "task": "Square",
        "robots": ("Panda",),
        "object_layout": "absolute-first",
        "action_frame": "world",
        "action_scale": ActionScale(0.05, 0.5),
        "render": None,
        "labels": None,
        "low_dim": 23,
        "actions": 7,
        "step": 20,
    }
    own = {"algorithm": config.algorithm, "seed": config.seed, "training": to_dict(config)}
    return PolicyHeader(**(square | own | changes))


def write_random_policy(path: Path, data: Path, training: PolicyTraining, step: int = 20) -> Path:
    """An untrained policy's file, described as training on ``data`` would."""
    header = read(training, data).header
    network = make_network(training, header.low_dim, header.actions).eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    save_policy(network, replace(header, step=step), path)
    return path


def result_of(
    training: PolicyTraining, successes: Sequence[int], episodes: int = 10, step: int = 100, **changes
) -> PolicyResult:
    """An evaluation with so many successes at each checkpoint; the first episodes succeed."""
    name = hashlib.sha256(repr((training, changes)).encode()).hexdigest()

    def checkpoint(i: int, good: int) -> CheckpointResult:
        runs = [
            EpisodeResult(20000 + episodes * i + j, j < good, 150, None if j < good else "time-out")
            for j in range(episodes)
        ]
        return CheckpointResult(step * (i + 1), f"{name}{i}", wilson(good, episodes), tuple(runs))

    content = {
        "task": "Square",
        "robot": "Panda",
        "algorithm": training.algorithm,
        "training": to_dict(training),
        "labels": None,
        "rewards": None,
        "planner_sha256": None,
        "settings": EvaluationSettings(episodes),
        "privileged": ("object pose",),
        "checkpoints": tuple(checkpoint(i, good) for i, good in enumerate(successes)),
        "command": "ocplanner evaluate --policy runs/bc",
        "versions": {"mujoco": "3.7.0"},
    }
    return PolicyResult(**(content | changes))
