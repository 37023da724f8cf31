"""Untrained policies and a labelled data set, for tests that need a policy with a hint but not a good one."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from ocplanner.files.records.labels import LABEL_ATTRIBUTE
from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.config import HintConfig, NetworkConfig, ObservationConfig, PolicyTraining, preset
from ocplanner.policies.network import make_network
from ocplanner.policies.policy import save_policy
from ocplanner.policies.train import read
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


def write_random_policy(path: Path, data: Path, training: PolicyTraining, step: int = 20) -> Path:
    """An untrained policy's file, described as training on ``data`` would."""
    about = read(training, data).about
    actor = make_network(training, about["low_dim"], about["actions"]).eval()
    path.parent.mkdir(parents=True, exist_ok=True)
    save_policy(actor, {**about, "step": step, "training": to_dict(training)}, path)
    return path
