"""What proposes actions like the recorded ones to the critics of BCQ: a VAE, or a Gaussian mixture.

Both turn standard normal noise into actions, so that whoever gives the noise decides what is proposed.
"""

import itertools
from typing import Any

import torch
from torch import Tensor, nn

from ocplanner.policies.bc import BC
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.observation import Observation, ObservationEncoder


def make_sampler(config: PolicyTraining, bcq: BCQConfig, low_dim: int, actions: int) -> "ActionVAE | ActionGmm":
    """The sampler that a configuration names."""
    if bcq.sampler == "vae":
        return ActionVAE(config, bcq, low_dim, actions)
    return (TrainedPolicy if bcq.sampler == "policy" else ActionGmm)(config, low_dim, actions)


class ActionVAE(nn.Module):
    """A conditional VAE of actions with the prior N(0, 1); a tanh keeps its actions in (-1, 1).

    As in robomimic, encoder and decoder have observation encoders of their own.

    Attributes:
        noise: L, width of the latent.
    """

    def __init__(self, config: PolicyTraining, bcq: BCQConfig, low_dim: int, actions: int) -> None:
        super().__init__()
        self.noise, self.kl_weight = bcq.latent, bcq.kl_weight
        self.encoder_seen = ObservationEncoder(config.observation, low_dim)
        self.encoder = layers(actions + self.encoder_seen.features, bcq.vae_hidden)
        # Mean and log-variance in one product.
        self.posterior = nn.Linear(bcq.vae_hidden[-1], 2 * bcq.latent)
        self.decoder_seen = ObservationEncoder(config.observation, low_dim)
        self.decoder = layers(bcq.latent + self.decoder_seen.features, bcq.vae_hidden)
        self.action = nn.Linear(bcq.vae_hidden[-1], actions)

    def forward(self, observation: Observation, actions: Tensor, noise: Tensor) -> dict[str, Tensor]:
        """Mean squared error of reconstructed actions, KL divergence from the prior, summed over the latent, ``loss``.

        Args:
            observation: of B steps.
            actions: (B, A) recorded.
            noise: (B, L) standard normal, decides where in the posterior is looked.
        """
        encoded = self.encoder(torch.cat([actions, self.encoder_seen(observation)], dim=-1))
        mean, log_variance = self.posterior(encoded).chunk(2, dim=-1)
        latent = mean + (0.5 * log_variance).clamp(-4, 15).exp() * noise
        reconstructed = self._decode(self.decoder_seen(observation), latent)
        kl = -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).sum(dim=-1).mean()
        reconstruction = nn.functional.mse_loss(reconstructed, actions)
        return {"loss": reconstruction + self.kl_weight * kl, "vae_reconstruction": reconstruction, "kl": kl}

    def propose(self, observation: Observation, noise: Tensor) -> Tensor:
        """(B, n, A) actions of B observations from (B, n, L) latents, standard normal ones for samples of the prior."""
        features = self.decoder_seen(observation)
        return self._decode(features.unsqueeze(1).expand(-1, noise.shape[1], -1), noise)

    def _decode(self, features: Tensor, latent: Tensor) -> Tensor:
        return self.action(self.decoder(torch.cat([latent, features], dim=-1))).tanh()

    def __call__(self, *args: Any, **kwargs: Any) -> dict[str, Tensor]:
        """See :meth:`forward`."""
        return super().__call__(*args, **kwargs)


class ActionGmm(nn.Module):
    """The policy of BC, robomimic's sampler in ``BCQ_GMM``: its modes differ where people acted differently.

    Attributes:
        noise: 1 + A: one number chooses the mode, the others the place in it.
    """

    def __init__(self, config: PolicyTraining, low_dim: int, actions: int) -> None:
        super().__init__()
        self.noise, self._low_noise = 1 + actions, config.network.gmm.low_noise
        self.actor = BC(config, low_dim, actions)

    def forward(self, observation: Observation, actions: Tensor, _: Tensor) -> dict[str, Tensor]:
        """Mean negative log-likelihood of recorded actions (B, A); noise is not needed."""
        return {"loss": self.actor(observation, actions)}

    def propose(self, observation: Observation, noise: Tensor) -> Tensor:
        """(B, n, A) actions of B observations from (B, n, 1 + A) standard normal numbers."""
        mixture, _ = self.actor.distribution(observation)
        return mixture.at(noise, self._low_noise)

    def __call__(self, *args: Any, **kwargs: Any) -> dict[str, Tensor]:
        """See :meth:`forward`."""
        return super().__call__(*args, **kwargs)


class TrainedPolicy(ActionGmm):
    """A policy that BC trained before; nothing in it changes, and observations are encoded once for it and the critics.

    :meth:`propose` is given what :meth:`encode` made of an observation.
    """

    def __init__(self, config: PolicyTraining, low_dim: int, actions: int) -> None:
        super().__init__(config, low_dim, actions)
        self.requires_grad_(False).eval()

    @property
    def width(self) -> int:
        """How many features :meth:`encode` makes of an observation."""
        return self.actor.encoder.features

    def encode(self, observation: Observation) -> Observation:
        """The same observation, its numbers the features that the policy's own layers read."""
        return Observation(self.actor.encode(observation), {}, None)

    def propose(self, observation: Observation, noise: Tensor) -> Tensor:
        """(B, n, A) actions of B encoded observations; otherwise as in :class:`ActionGmm`."""
        features, _ = self.actor.features(observation.low_dim, None)
        return self.actor.head(features).at(noise, self._low_noise)

    def train(self, mode: bool = True) -> "TrainedPolicy":  # noqa: ARG002
        """Stay as in rollouts: statistics of batch normalisation do not move."""
        return super().train(False)


def layers(inputs: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Linear layers with a ReLU after each."""
    pairs = itertools.pairwise((inputs, *hidden))
    return nn.Sequential(*(layer for i, o in pairs for layer in (nn.Linear(i, o), nn.ReLU())))
