"""What a policy sees as tensors, and the network that turns it into one feature vector."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ocplanner.planner.encoder import ImageEncoder
from ocplanner.policies.config import ObservationConfig

_FEWEST = 2
"""Batch normalisation needs more than one picture."""
_SMALLEST_STD = 1e-3
"""Numbers that hardly change (a constant quaternion component) are not blown up."""


class Observation(NamedTuple):
    """A batch of observations; ``...`` is (B,) for BC and (T, B), time first, for BC-RNN.

    Attributes:
        low_dim: (..., D) float32, the low-dimensional numbers one after the other, as recorded.
        images: camera -> (..., 3, crop, crop) float32 in [0, 1].
        hint: (..., 6 K + 1) float32, or None without hints.
    """

    low_dim: Tensor
    images: dict[str, Tensor]
    hint: Tensor | None


class ObservationEncoder(nn.Module):
    """Observations to (..., features): the standardised numbers, then the features of each camera."""

    mean: Tensor
    std: Tensor

    def __init__(self, config: ObservationConfig, low_dim: int) -> None:
        super().__init__()
        self.config = config
        self.cameras = nn.ModuleDict({name: ImageEncoder(config.encoder, config.crop) for name in config.cameras})
        self.features = low_dim + len(config.cameras) * config.encoder.feature
        self.register_buffer("mean", torch.zeros(low_dim))
        self.register_buffer("std", torch.ones(low_dim))

    def fit(self, low_dim: Tensor) -> None:
        """Take the statistics of (N, D) training numbers, if the configuration asks for it."""
        if self.config.normalise:
            numbers = low_dim.double()
            self.mean.copy_(numbers.mean(dim=0))
            self.std.copy_(numbers.std(dim=0, correction=0).clamp_min(_SMALLEST_STD))

    def forward(self, observation: Observation, blind: Tensor | None = None) -> Tensor:
        """Features; those of the cameras are zero where ``blind`` (...,) bool says so."""
        low_dim = observation.low_dim
        parts = [(low_dim - self.mean) / self.std if self.config.normalise else low_dim]
        for name, encoder in self.cameras.items():
            image = observation.images[name]
            parts.append(_encoded(encoder, image.flatten(0, -4), blind).unflatten(0, image.shape[:-3]))
        return torch.cat(parts, dim=-1) if len(parts) > 1 else parts[0]


def _encoded(encoder: nn.Module, images: Tensor, blind: Tensor | None) -> Tensor:
    if blind is None:
        return encoder(images)
    seen = ~blind.flatten()
    if seen.sum() < _FEWEST:
        return encoder(images) * seen[:, None]
    features = encoder(images[seen])
    return features.new_zeros(len(images), features.shape[-1]).masked_scatter(seen[:, None], features)


def fit_encoders(network: nn.Module, low_dim: Tensor) -> None:
    """Let every observation encoder of a network take the statistics of (N, D) training numbers."""
    for module in network.modules():
        if isinstance(module, ObservationEncoder):
            module.fit(low_dim)


def cropped(images: np.ndarray, crop: int, rng: np.random.Generator | None) -> Tensor:
    """(..., 3, crop, crop) float32 in [0, 1] from (..., h, w, 3) uint8.

    Args:
        images: upright pictures.
        crop: side of the crop, pixels.
        rng: chooses a place for each picture; None: the centre.
    """
    height, width = images.shape[-3:-1]
    flat = images.reshape(-1, height, width, 3)
    if rng is None:
        top, left = (height - crop) // 2, (width - crop) // 2
        cut = flat[:, top : top + crop, left : left + crop]
    else:
        top = rng.integers(0, height - crop + 1, len(flat))
        left = rng.integers(0, width - crop + 1, len(flat))
        cut = np.stack([image[y : y + crop, x : x + crop] for image, y, x in zip(flat, top, left)])
    pixels = torch.from_numpy(np.ascontiguousarray(cut)).permute(0, 3, 1, 2).float().div_(255)
    return pixels.reshape(*images.shape[:-3], 3, crop, crop)


def low_dim_row(observation: Mapping[str, np.ndarray], keys: tuple[str, ...]) -> np.ndarray:
    """(..., D) float32: the named arrays (..., d) one after the other."""
    return np.concatenate([np.asarray(observation[key], dtype=np.float32) for key in keys], axis=-1)
