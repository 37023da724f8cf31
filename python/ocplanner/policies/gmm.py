"""The Gaussian mixture over actions, with robomimic's parametrisation."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ocplanner.policies.config import GmmConfig

LOW_NOISE_STD = 1e-4
_LOG_ROOT_TWO_PI = 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True)
class Mixture:
    """Mixtures of M diagonal Gaussians over A-dimensional actions.

    Attributes:
        logits: (..., M) unnormalised log-probabilities of the modes.
        means: (..., M, A).
        stds: (..., M, A), positive.
    """

    logits: Tensor
    means: Tensor
    stds: Tensor

    def log_likelihood(self, actions: Tensor) -> Tensor:
        """(...,) log-density of actions (..., A)."""
        z = (actions.unsqueeze(-2) - self.means) / self.stds
        modes = -(0.5 * z.square() + self.stds.log()).sum(dim=-1) - _LOG_ROOT_TWO_PI * actions.shape[-1]
        return torch.logsumexp(self.logits.log_softmax(dim=-1) + modes, dim=-1)

    def sample(self, low_noise: bool, generator: torch.Generator | None = None) -> Tensor:
        """(..., A): a mode drawn by its probability, then an action around its mean.

        Args:
            low_noise: draw with a standard deviation of 1e-4 instead of the mode's.
            generator: source of the random numbers.
        """
        weights = self.logits.softmax(dim=-1)
        mode = torch.multinomial(weights.flatten(0, -2), 1, generator=generator).reshape(*weights.shape[:-1], 1, 1)
        index = mode.expand(*weights.shape[:-1], 1, self.means.shape[-1])
        mean = self.means.gather(-2, index).squeeze(-2)
        noise = torch.randn(mean.shape, generator=generator, device=mean.device, dtype=mean.dtype)
        return mean + noise * (LOW_NOISE_STD if low_noise else self.stds.gather(-2, index).squeeze(-2))

    def at(self, noise: Tensor, low_noise: bool) -> Tensor:
        """(B, n, A): n actions of each of B mixtures, as :meth:`sample` draws them, but decided by the noise.

        Args:
            noise: (B, n, 1 + A) standard normal numbers: the mode's, then the action's around its mean.
            low_noise: as in :meth:`sample`.
        """
        share = torch.special.ndtr(noise[..., :1])
        mode = (share > self.logits.softmax(dim=-1).cumsum(dim=-1)[:, None, :-1]).sum(dim=-1)  # (B, n)
        index = mode[..., None].expand(*mode.shape, self.means.shape[-1])
        around = noise[..., 1:] * (LOW_NOISE_STD if low_noise else self.stds.gather(1, index))
        return self.means.gather(1, index) + around


class GmmHead(nn.Module):
    """One linear layer from features (..., F) to a mixture over A-dimensional actions."""

    def __init__(self, features: int, actions: int, config: GmmConfig) -> None:
        super().__init__()
        self.config, self.actions = config, actions
        # Means, deviations and logits in one product; initialised as three layers of the same input would be.
        self.linear = nn.Linear(features, config.modes * (2 * actions + 1))

    def forward(self, features: Tensor) -> Mixture:
        """The mixture."""
        size = self.config.modes * self.actions
        means, stds, logits = self.linear(features).split([size, size, self.config.modes], dim=-1)
        shape = (self.config.modes, self.actions)
        means = means.unflatten(-1, shape)
        stds = stds.unflatten(-1, shape)
        stds = nn.functional.softplus(stds) if self.config.std_activation == "softplus" else stds.exp()
        return Mixture(logits, means.tanh() if self.config.tanh_means else means, stds + self.config.min_std)
