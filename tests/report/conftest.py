import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ocplanner.files.records.labels import LabelRecord
from ocplanner.settings import to_dict
from random_policy import random_training, result_of


@pytest.fixture
def write_run(tmp_path):
    """Writes a run folder as training leaves it."""

    def write(name: str, horizon: int = 20, seed: int = 0, steps: int = 5) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "config.yaml").write_text(
            f"preset: cpu\nobserve: masked\nseed: {seed}\nnetwork:\n  horizon: {horizon}\n  outputs: pose\n"
            "  encoder:\n    type: small\n"
        )
        errors = {"ade_mm": 30.0, "fde_mm": 40.0, "rotation_deg": 9.0}
        rows = [
            {"stage": stage, "step": 100 * i, "seconds": 1.0, "loss": 1.0, "valid_loss": 2.0 / (i + 1), **errors}
            for stage in ("vae", "predictor", "finetune")
            for i in range(steps)
        ]
        rows += [
            {"stage": "final", "candidate": stage, "kept": stage == "finetune", "appearance": arm, **errors}
            for stage in ("predictor", "finetune")
            for arm in ("source", "IIWA")
        ]
        (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        return folder

    return write


@pytest.fixture
def write_result(tmp_path):
    """Writes a transfer result as ``ocplanner transfer`` does."""

    def write(name: str = "transfer", *, successes: int = 2, failures: tuple[str, ...] = ("slip",), **changes) -> Path:
        outcomes = [None] * successes + list(failures)
        runs = [
            {"seed": 10000 + i, "success": failure is None, "steps": 150 + i, "failure": failure}
            for i, failure in enumerate(outcomes)
        ]
        content = {
            "task": "Square", "robot": "Sawyer", "follow": "gated", "observe": "masked",
            "patches": ["sawyer-base-contact"],
            "episodes": len(runs), "successes": successes, "interval": [0.2, 0.9],
            "planner_sha256": "ab" * 32, "planner_seed": None, "command": "ocplanner transfer --robot Sawyer",
            "versions": {"mujoco": "3.9.0"}, "runs": runs,
        }  # fmt: skip
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps(content | changes))
        return path

    return write


@pytest.fixture
def write_evaluation(tmp_path):
    """Writes an evaluation as ``ocplanner evaluate`` does: ``successes`` of 10 episodes for each checkpoint."""

    def write(
        name: str, successes=(2, 6, 4), *, hint=None, seed=0, step=100, origin="object", rewards=None, **settings
    ) -> Path:
        training = replace(random_training(hint=hint, seed=seed), **settings)
        labels = None if hint is None else LabelRecord("cd" * 32, {"horizon_steps": list(hint), "hint_from": origin})
        planner = None if hint is None else "cd" * 32
        result = result_of(training, successes, step=step, labels=labels, rewards=rewards, planner_sha256=planner)
        return result.save(tmp_path / f"{name}.json")

    return write


@pytest.fixture
def write_policy_run(tmp_path):
    """Writes the run folder of a policy as training leaves it, without its weights."""

    def write(name: str, hint=None, seed: int = 0) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        settings = to_dict(random_training(hint=hint, seed=seed)) | {"data": "360 steps, crc32 00000000"}
        (folder / "config.yaml").write_text(yaml.safe_dump(settings))
        rows = [
            {"stage": "train", "step": 100 * i, "loss": -float(i), "valid_loss": i**4 - 3.0, "steps_per_second": 50.0}
            for i in range(1, 5)
        ]
        (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
        return folder

    return write
