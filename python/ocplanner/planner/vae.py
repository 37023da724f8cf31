"""The LSTM variational autoencoder of object trajectories (the paper's section 3, equations 1 and 2)."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ocplanner.planner.config import LossConfig, NetworkConfig


class Latent(NamedTuple):
    """A diagonal Gaussian over latent plans: ``mu`` and ``log_sigma``, both (..., latent)."""

    mu: Tensor
    log_sigma: Tensor


class TrajectoryEncoder(nn.Module):
    """From (B, H, 3 or 9) normalised trajectories to a posterior over latent plans."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.lstm = nn.LSTM(config.step_size, config.trajectory_hidden, batch_first=True)
        self.head = nn.Linear(config.trajectory_hidden, 2 * config.latent)

    def forward(self, trajectory: Tensor) -> Latent:
        """Posterior of each trajectory."""
        outputs, _ = self.lstm(trajectory)
        mu, log_sigma = self.head(outputs[:, -1]).chunk(2, dim=-1)
        return Latent(mu, log_sigma.clamp(-8, 4))


class TrajectoryDecoder(nn.Module):
    """From (B, latent) latent plans to (B, H, 3 or 9) trajectories; the LSTM reads the latent at every step."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.horizon = config.horizon
        self.init = nn.Linear(config.latent, 2 * config.decoder_hidden)
        self.lstm = nn.LSTM(config.latent, config.decoder_hidden, batch_first=True)
        self.head = nn.Linear(config.decoder_hidden, config.step_size)

    def forward(self, z: Tensor) -> Tensor:
        """Trajectory of each latent plan."""
        hidden, cell = torch.tanh(self.init(z)).unsqueeze(0).chunk(2, dim=-1)
        inputs = z.unsqueeze(1).expand(-1, self.horizon, -1)
        outputs, _ = self.lstm(inputs, (hidden.contiguous(), cell.contiguous()))
        return self.head(outputs)


def trajectory_loss(predicted: Tensor, true: Tensor, weights: LossConfig) -> Tensor:
    """c_pos |m_pos - m'_pos|^2 + c_rot |m_rot - m'_rot|^2, summed over the horizon: (...,) from (..., H, 3 or 9)."""
    squares = (predicted - true).square()
    loss = weights.position * squares[..., :3].sum(dim=(-2, -1))
    return loss + weights.rotation * squares[..., 3:].sum(dim=(-2, -1))


def kl_to_prior(posterior: Latent) -> Tensor:
    """KL[N(mu, sigma) | N(0, I)], summed over the latent: (...,)."""
    mu, log_sigma = posterior
    return 0.5 * (mu.square() + (2 * log_sigma).exp() - 1 - 2 * log_sigma).sum(dim=-1)


def kl_between(predicted: Latent, true: Latent) -> Tensor:
    """KL[N(true) | N(predicted)], summed over the latent: (...,)."""
    ratio = 2 * (true.log_sigma - predicted.log_sigma)
    distance = (true.mu - predicted.mu).square() * (-2 * predicted.log_sigma).exp()
    return 0.5 * (ratio.exp() + distance - 1 - ratio).sum(dim=-1)
