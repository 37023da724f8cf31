"""The latent predictor: images to a distribution over latent plans (the paper's section 3, equation 3)."""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from ocplanner.planner.config import LossConfig, NetworkConfig
from ocplanner.planner.encoder import ImageEncoder
from ocplanner.planner.vae import Latent, kl_between


class Prediction(NamedTuple):
    """Alternative latent plans for each image: ``latent`` has mu and log_sigma (B, M, latent), ``logits`` is (B, M)."""

    latent: Latent
    logits: Tensor

    @property
    def best(self) -> Tensor:
        """(B, latent) mean of the most probable mode."""
        rows = torch.arange(len(self.logits), device=self.logits.device)
        return self.latent.mu[rows, self.logits.argmax(dim=1)]


class LatentPredictor(nn.Module):
    """One encoder for each camera; a multilayer perceptron on their concatenated features."""

    def __init__(self, config: NetworkConfig, cameras: tuple[str, ...]) -> None:
        super().__init__()
        self.modes, self.latent = config.modes, config.latent
        self.encoders = nn.ModuleDict({camera: ImageEncoder(config.encoder, config.crop) for camera in cameras})
        outputs = config.modes * 2 * config.latent + (config.modes if config.modes > 1 else 0)
        widths = (len(cameras) * config.encoder.feature, *config.predictor_hidden, outputs)
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in itertools.pairwise(widths))

    def forward(self, images: Mapping[str, Tensor]) -> Prediction:
        """Latent plans for images {camera: (B, 3, crop, crop) float32 in [0, 1]}."""
        x = torch.cat([encoder(images[camera]) for camera, encoder in self.encoders.items()], dim=1)
        for layer in self.layers[:-1]:
            x = torch.relu(layer(x))
        x = self.layers[-1](x)
        split = self.modes * 2 * self.latent
        latent = x[:, :split].unflatten(1, (self.modes, 2, self.latent))
        logits = x[:, split:] if self.modes > 1 else x.new_zeros(len(x), 1)
        return Prediction(Latent(latent[:, :, 0], latent[:, :, 1].clamp(-8, 4)), logits)


def latent_distance(predicted: Latent, true: Latent, weights: LossConfig) -> Tensor:
    """|{mu', sigma'} - {mu, sigma}|^2 (the paper's choice) or the KL divergence: (...,)."""
    if weights.latent == "kl":
        return kl_between(predicted, true)
    means = (predicted.mu - true.mu).square().sum(dim=-1)
    return means + (predicted.log_sigma.exp() - true.log_sigma.exp()).square().sum(dim=-1)


def winner_takes_all(losses: Tensor, logits: Tensor, weights: LossConfig) -> Tensor:
    """Batch mean of the closest mode's loss, plus a share of all modes' and the loss of predicting the closest.

    Args:
        losses: (B, M) loss of each mode.
        logits: (B, M) unnormalised log probabilities of the modes.
        weights: gives ``other_modes``.
    """
    if losses.shape[1] == 1:
        return losses.mean()
    closest = losses.detach().argmin(dim=1)
    winner = losses.gather(1, closest[:, None]).mean()
    return (1 - weights.other_modes) * winner + weights.other_modes * losses.mean() + F.cross_entropy(logits, closest)
