"""The whole planner as one torch module, and the arithmetic between poses and network numbers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from ocplanner.planner.config import NetworkConfig
from ocplanner.planner.predictor import LatentPredictor
from ocplanner.planner.vae import TrajectoryDecoder, TrajectoryEncoder


class PlannerNetwork(nn.Module):
    """Trajectory encoder and decoder (the VAE) and the latent predictor."""

    def __init__(self, config: NetworkConfig, cameras: tuple[str, ...]) -> None:
        super().__init__()
        self.trajectory_encoder = TrajectoryEncoder(config)
        self.decoder = TrajectoryDecoder(config)
        self.predictor = LatentPredictor(config, cameras)

    def forward(self, images: Mapping[str, Tensor]) -> Tensor:
        """(B, H, 3 or 9) normalised plan of the most probable mode, from {camera: (B, 3, crop, crop) in [0, 1]}."""
        return self.decoder(self.predictor(images).best)


@dataclass(frozen=True)
class Normaliser:
    """Mean and standard deviation (3,) float64, metres, of the training data's object positions."""

    mean: np.ndarray
    std: np.ndarray

    @classmethod
    def fit(cls, positions: np.ndarray) -> "Normaliser":
        """Statistics of (..., 3) positions; an axis without spread keeps a scale of 1 mm."""
        flat = positions.reshape(-1, 3).astype(np.float64)
        return cls(flat.mean(axis=0), np.maximum(flat.std(axis=0), 1e-3))

    def encode(self, positions: np.ndarray, rotations: np.ndarray | None) -> np.ndarray:
        """(..., 3) metres and (..., 3, 3) to (..., 3 or 9) float32 network numbers."""
        scaled = (positions - self.mean) / self.std
        if rotations is None:
            return scaled.astype(np.float32)
        return np.concatenate([scaled, rot6d_from_matrix(rotations)], axis=-1).astype(np.float32)

    def decode(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """The inverse: float64 positions in metres, and rotations when there are 9 numbers a step."""
        numbers = numbers.astype(np.float64)
        positions = numbers[..., :3] * self.std + self.mean
        return positions, matrix_from_rot6d(numbers[..., 3:9]) if numbers.shape[-1] == 9 else None


def rot6d_from_matrix(rotations: np.ndarray) -> np.ndarray:
    """(..., 3, 3) to (..., 6): the first column, then the second (Zhou et al.)."""
    return np.concatenate([rotations[..., :, 0], rotations[..., :, 1]], axis=-1)


def matrix_from_rot6d(rot6d: np.ndarray) -> np.ndarray:
    """(..., 6) to (..., 3, 3) by Gram-Schmidt; degenerate columns give an arbitrary finite result."""
    first = _unit(rot6d[..., :3])
    second = rot6d[..., 3:6] - (first * rot6d[..., 3:6]).sum(axis=-1, keepdims=True) * first
    second = _unit(second)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def planned(network: PlannerNetwork, images: Mapping[str, Tensor]) -> np.ndarray:
    """Plan without gradients, in evaluation mode: (B, H, 3 or 9) float32."""
    training = network.training
    network.eval()
    with torch.inference_mode():
        plan = network(images)
    network.train(training)
    return plan.cpu().numpy()
