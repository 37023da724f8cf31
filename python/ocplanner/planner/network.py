"""The whole planner as one torch module, and the conversion between poses and network numbers."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from torch import Tensor, nn

from ocplanner.geometry.rotation import rotation_from_6d, rotation_to_6d
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
        """Statistics of (..., 3) positions; the standard deviation is at least 1 mm."""
        flat = positions.reshape(-1, 3).astype(np.float64)
        return cls(flat.mean(axis=0), np.maximum(flat.std(axis=0), 1e-3))

    def encode(self, positions: np.ndarray, rotations: np.ndarray | None) -> np.ndarray:
        """(..., 3) metres and (..., 3, 3) to (..., 3 or 9) float32 network numbers."""
        scaled = (positions - self.mean) / self.std
        if rotations is None:
            return scaled.astype(np.float32)
        return np.concatenate([scaled, rotation_to_6d(rotations.astype(np.float64))], axis=-1).astype(np.float32)

    def decode(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """The inverse: float64 positions in metres, and rotations if there are 9 numbers a step.

        Raises:
            InvalidValueError: six numbers give no rotation: two columns are zero, parallel or not finite.
        """
        numbers = numbers.astype(np.float64)
        positions = numbers[..., :3] * self.std + self.mean
        return positions, rotation_from_6d(numbers[..., 3:].copy()) if numbers.shape[-1] == 9 else None
