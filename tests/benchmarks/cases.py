"""The cases that ``bench_core.py`` measures: one class per kind of job, one entry of :data:`CASES` per row."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy_delta_pose import delta_pose_action
from numpy_reward import Rewards, plan_reward
from peers import PEERS, AbsentError, Images, Peer
from planner_weights import PlannerWeights
from timing import Timing, interleaved

from ocplanner import Planner, _core
from ocplanner.guidance import rewards, settings
from random_planner import random_images, write_random_planner

_TRAINED = Path(__file__).parents[2] / "results" / "planners" / "square_masked_h20_pose_0.safetensors"

RESNET18 = {
    "horizon": 50,
    "latent": 32,
    "encoder": {"type": "resnet18", "pool": "spatial_softmax", "keypoints": 32, "feature": 64},
    "predictor": {"hidden": [1024, 1024]},
    "decoder": {"hidden": 256},
}
"""The ``robomimic`` preset's network at the paper's longest horizon."""

_FARTHEST = {"f32": 1e-3, "bf16": 1e-2}
"""The largest allowed distance (m, and per entry of a rotation) of our plan from a peer's float32 one, by storage."""

_SETTLE_S = 0.003
"""Seconds of sleep before a timing where peers have threads, whose idle spinning must not slow the next side."""


class DisagreementError(Exception):
    """Two sides do not compute the same, so their times must not be compared."""


@dataclass(frozen=True)
class Measured:
    """Times of one case by side, ``ours`` among them, and why peers are absent."""

    timings: dict[str, Timing]
    absent: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class PlanCase:
    """Planning a batch of images, against every peer."""

    encoder: str
    batch: int
    storage: str
    threads: int
    unit: str = "ms"

    def measure(self, seconds: float, skip: list[str]) -> Measured:
        """Check that all sides agree, then time them.

        Raises:
            DisagreementError: a peer's plan differs from ours.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = _planner_file(self.encoder, Path(folder))
            planner = Planner.load(path, storage=self.storage)
            weights = PlannerWeights.load(path)
        images = random_images(weights.config, self.batch)
        sides: dict[str, Callable[[], object]] = {"ours": lambda: planner.plan(images, threads=self.threads)}
        present, absent = _peers(weights, self.batch, self.threads, skip)
        for name, peer in present.items():
            _check_plans(name, planner, peer.plan(images), images, _FARTHEST[self.storage])
            sides[name] = lambda peer=peer: peer.plan(images)
        return Measured(interleaved(sides, seconds, pause=_SETTLE_S if self.threads > 1 else 0.0), absent)


@dataclass(frozen=True)
class LabelCase:
    """Rewards of one demonstration in which the object is held throughout, against every peer with NumPy."""

    frames: int
    peers_plan: int
    """Steps that the peers' models plan. Ours decodes only the step compared; a peer needs a model made for that."""
    threads: int = 1
    unit: str = "ms"

    def measure(self, seconds: float, skip: list[str]) -> Measured:
        """Check that all sides find the same rewards, then time them.

        Raises:
            DisagreementError: a peer's terms differ from ours.
        """
        planner, weights = Planner.load(_TRAINED), PlannerWeights.load(_TRAINED)
        images = random_images(weights.config, self.frames)
        plan = planner.plan(images)
        rng = np.random.default_rng(0)
        turns = _core.rotation_exp(rng.normal(0, 0.1, (self.frames, 3)))
        achieved = (plan.position[:, 0] + rng.normal(0, 0.02, (self.frames, 3)), turns @ plan.rotation[:, 0])
        held = np.ones(self.frames, np.bool_)

        def ours() -> rewards.Rewards:
            return _rewards(planner, images, achieved, held)

        sides: dict[str, Callable[[], object]] = {"ours": ours}
        present, absent = _peers(weights.planning(self.peers_plan), self.frames, self.threads, skip)
        for name, peer in present.items():

            def label(peer: Peer = peer) -> Rewards:
                position, rotation = peer.plan(images)
                return plan_reward((position[:, 0], rotation[:, 0]), achieved, held)

            for what, mine, other in zip(Rewards._fields, ours(), label()):
                if not np.allclose(other, mine, rtol=1e-3, atol=1e-6):
                    raise DisagreementError(f"{name}: {what} is up to {np.abs(other - mine).max():.1e} from ours")
            sides[name] = label
        return Measured(interleaved(sides, seconds), absent)


@dataclass(frozen=True)
class DeltaPoseCase:
    """One control step's action from poses, against NumPy."""

    unit: str = "us"

    def measure(self, seconds: float, skip: list[str]) -> Measured:
        """Check that both sides agree on many poses, then time one call.

        Raises:
            DisagreementError: the actions differ.
        """
        for seed in range(100):
            poses = _random_poses(seed)
            apart = np.abs(_core.delta_pose_action(*poses) - delta_pose_action(*poses)).max()
            if not apart < 1e-6:
                raise DisagreementError(f"numpy's action is {apart:.1e} from ours")
        sides: dict[str, Callable[[], object]] = {
            "ours": lambda: _core.delta_pose_action(*poses),
            "numpy": lambda: delta_pose_action(*poses),
        }
        return Measured(interleaved(sides, seconds, repeat=200))


def _rewards(
    planner: Planner, images: Images, achieved: tuple[np.ndarray, np.ndarray], held: np.ndarray
) -> rewards.Rewards:
    """What ``ocplanner label --no-hints --reward`` computes of a demonstration, batch by batch."""
    batch, plans = settings.LabelSettings().batch, []
    for start in range(0, len(held), batch):
        part = {camera: pictures[start : start + batch] for camera, pictures in images.items()}
        plans.append(planner.plan(part, steps=1))
    position, rotation = (np.concatenate([plan[part][:, 0] for plan in plans]) for part in (0, 1))
    return rewards.plan_reward((position, rotation), achieved, held)


def _peers(
    weights: PlannerWeights, batch: int, threads: int, skip: list[str]
) -> tuple[dict[str, Peer], dict[str, str]]:
    """Every peer that can run here, and why the others cannot."""
    present, absent = {}, {}
    for name, kind in PEERS.items():
        if name in skip:
            absent[name] = "skipped"
            continue
        try:
            present[name] = kind(weights, batch, threads)
        except AbsentError as reason:
            absent[name] = str(reason)
    return present, absent


def _planner_file(encoder: str, folder: Path) -> Path:
    if encoder == "cpu h20":
        return _TRAINED
    path = folder / "planner.safetensors"
    write_random_planner(path, **RESNET18)
    return path


def _check_plans(name: str, planner: Planner, theirs: tuple, images: Images, farthest: float) -> None:
    ours = planner.plan(images)
    for what, mine, other in (("position", ours.position, theirs[0]), ("rotation", ours.rotation, theirs[1])):
        if mine.shape != other.shape:
            raise DisagreementError(f"{name}: {what} has shape {other.shape}, ours {mine.shape}")
        apart = np.abs(mine - other).max()
        if not apart < farthest:
            raise DisagreementError(f"{name}: {what} is up to {apart:.1e} from ours, allowed is {farthest:.0e}")


def _random_poses(seed: int) -> tuple:
    """Poses of an object, its target 3 cm and 0.4 rad away, and the hand that holds it; the base's rotation."""
    rng = np.random.default_rng(seed)

    def rotation(largest: float) -> np.ndarray:
        axis = rng.standard_normal(3)
        return _core.rotation_exp(axis * largest / np.linalg.norm(axis))

    at, turned = rng.uniform(-0.3, 0.3, 3), rotation(2.0)
    target = (at + rng.uniform(-0.03, 0.03, 3), rotation(0.4) @ turned)
    return (at, turned), target, (at + rng.uniform(-0.05, 0.05, 3), rotation(3.0)), rotation(1.0)


CASES: dict[str, PlanCase | LabelCase | DeltaPoseCase] = {
    "resnet18 h50 batch 1 f32 1 thread": PlanCase("resnet18 h50", 1, "f32", 1),
    "resnet18 h50 batch 1 bf16 1 thread": PlanCase("resnet18 h50", 1, "bf16", 1),
    "resnet18 h50 batch 64 f32 1 thread": PlanCase("resnet18 h50", 64, "f32", 1),
    "resnet18 h50 batch 64 f32 2 threads": PlanCase("resnet18 h50", 64, "f32", 2),
    "cpu h20 batch 1 f32 1 thread": PlanCase("cpu h20", 1, "f32", 1),
    "cpu h20 batch 64 f32 1 thread": PlanCase("cpu h20", 64, "f32", 1),
    "cpu h20 batch 64 f32 2 threads": PlanCase("cpu h20", 64, "f32", 2),
    "label cpu h20 150 frames": LabelCase(150, peers_plan=1),
    "label cpu h20 150 frames, peers plan all steps": LabelCase(150, peers_plan=20),
    "delta-pose step": DeltaPoseCase(),
}
"""Case name -> how it is measured. The name states encoder, horizon, batch, our weight storage and threads."""
