"""Synthetic frames: a square slides along an arc; its place in the image tells where it is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ocplanner.planner.config import (
    AugmentationConfig,
    EncoderConfig,
    NetworkConfig,
    PlannerTraining,
)
from ocplanner.planner.frames import CameraFrames, DataSettings, Frames, future
from ocplanner.training.schedule import StageConfig

MASK_RGB = (255, 0, 255)
SETTINGS = DataSettings("Square", "SquareNut", "Panda", "fast", MASK_RGB, ("IIWA", "Kinova3"))


def synthetic_frames(demonstrations: int, horizon: int, seed: int, steps: int = 24, size: int = 84) -> Frames:
    """Frames of masked observation with one camera and two silhouettes."""
    rng = np.random.default_rng(seed)
    cameras, futures = [], []
    for _ in range(demonstrations):
        time = np.linspace(0, 1, steps)
        start = rng.uniform(-0.1, 0.1, size=2)
        goal = np.array([0.23, 0.10])
        xy = start + (goal - start) * time[:, None]
        positions = np.column_stack([xy, 0.9 + 0.1 * np.sin(np.pi * time)])
        yaw = rng.uniform(-1, 1) * (1 - time)
        zero, one = np.zeros(steps), np.ones(steps)
        rotations = np.stack(
            [np.cos(yaw), -np.sin(yaw), zero, np.sin(yaw), np.cos(yaw), zero, zero, zero, one], axis=1
        ).reshape(steps, 3, 3)
        futures.append(future(positions, rotations, np.arange(steps), horizon))
        empty = np.full((steps, size, size, 3), 60, np.uint8)
        mask = np.zeros((steps, size, size), bool)
        silhouettes = np.zeros((steps, 2, size, size), bool)
        for t, (x, y) in enumerate(xy):
            row, column = int(size * (0.25 + 1.5 * (x + 0.1))), int(size * (0.25 + 2 * (y + 0.1)))
            empty[t, row - 4 : row + 4, column - 4 : column + 4] = (200, 120, 40)
            mask[t, : max(row - 4, 6), column - 3 : column + 3] = True
            silhouettes[t, 0, : max(row - 4, 6), column - 8 : column] = True
            silhouettes[t, 1, : max(row - 4, 6), column : column + 8] = t % 5 > 0
        cameras.append(CameraFrames(scene=empty, mask=mask, silhouettes=silhouettes))
    counts = np.full(demonstrations, steps)
    joined = {name: np.concatenate([getattr(c, name) for c in cameras]) for name in ("scene", "mask", "silhouettes")}
    return Frames(
        cameras={"agentview": CameraFrames(**joined)},
        positions=np.concatenate([f.positions for f in futures]),
        rotations=np.concatenate([f.rotations for f in futures]),
        demonstration=np.repeat(np.arange(demonstrations, dtype=np.int32), counts),
        remaining=np.concatenate([np.arange(n, 0, -1, dtype=np.int32) for n in counts]),
        names=tuple(f"demo_{i}" for i in range(demonstrations)),
    )


def tiny_training(**changes) -> PlannerTraining:
    """Settings that train in a second or two."""
    network = NetworkConfig(
        horizon=5,
        latent=4,
        trajectory_hidden=16,
        decoder_hidden=16,
        predictor_hidden=(16,),
        encoder=EncoderConfig(channels=(4, 8, 8, 8), feature=8),
    )
    base = PlannerTraining(
        network=network,
        vae=StageConfig(steps=20, batch=16, warmup=2, ema=0.9),
        predictor=StageConfig(steps=12, batch=8, warmup=2, ema=0.9),
        finetune=StageConfig(steps=8, batch=8, warmup=2, ema=0.9),
        validate_every=6,
        checkpoint_every=5,
    )
    return replace(base, **changes)


@pytest.fixture(scope="session")
def frames() -> tuple[Frames, Frames]:
    """Training and held-out frames."""
    return synthetic_frames(5, 5, seed=0), synthetic_frames(2, 5, seed=1)


@pytest.fixture
def no_augmentation() -> AugmentationConfig:
    """Augmentation that changes nothing."""
    return AugmentationConfig(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)


@pytest.fixture(scope="session")
def tiny() -> Callable[..., PlannerTraining]:
    """Makes settings that train in a second or two."""
    return tiny_training


@pytest.fixture(scope="session")
def settings() -> DataSettings:
    """What a masked Square data set says about itself."""
    return SETTINGS
