"""Batch-constrained Q-learning (Fujimoto et al. 2019) as robomimic has it, without the perturbation of actions.

A sampler, conditioned on the observation, proposes actions like the recorded ones; critics choose among them.
"""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from ocplanner.policies.action_samplers import TrainedPolicy, layers, make_sampler
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.config import ObservationConfig, PolicyTraining
from ocplanner.policies.network import PolicyNetwork
from ocplanner.policies.observation import Observation, ObservationEncoder


class Critic(nn.Module):
    """Q(s, a)."""

    def __init__(self, config: PolicyTraining, bcq: BCQConfig, low_dim: int, actions: int) -> None:
        super().__init__()
        self.seen = ObservationEncoder(config.observation, low_dim)
        self.layers = layers(self.seen.features + actions, bcq.critic_hidden)
        self.value = nn.Linear(bcq.critic_hidden[-1], 1)

    def forward(self, observation: Observation, actions: Tensor) -> Tensor:
        """(B,) values of actions (B, A), or (B, n) of n actions (B, n, A) for each observation."""
        features = self.seen(observation)
        if actions.ndim == 3:  # an observation is encoded once for all of its actions
            features = features.unsqueeze(1).expand(-1, actions.shape[1], -1)
        return self.value(self.layers(torch.cat([features, actions], dim=-1))).squeeze(-1)


class Critics(nn.Module):
    """An ensemble of critics, each with its own observation encoder."""

    def __init__(self, config: PolicyTraining, bcq: BCQConfig, low_dim: int, actions: int) -> None:
        super().__init__()
        self.members = nn.ModuleList([Critic(config, bcq, low_dim, actions) for _ in range(bcq.critics)])

    def values(self, observation: Observation, actions: Tensor) -> Tensor:
        """(E, B) or (E, B, n): each critic's values, for actions as in :meth:`Critic.forward`."""
        return torch.stack([critic(observation, actions) for critic in self.members])

    def forward(self, observation: Observation, actions: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """(E,) mean squared error of each critic from targets (B,), and (E, B) their values."""
        values = self.values(observation, actions)
        return (values - targets).square().mean(dim=-1), values

    def __call__(self, *args: Any, **kwargs: Any) -> tuple[Tensor, Tensor]:
        """See :meth:`forward`."""
        return super().__call__(*args, **kwargs)


class BCQ(PolicyNetwork):
    """What acts: a sampler of actions and critics. Both are given what :meth:`encode` makes of an observation."""

    def __init__(self, config: PolicyTraining, low_dim: int, actions: int) -> None:
        super().__init__()
        self.config = BCQConfig.of(config)
        self.sampler = make_sampler(config, self.config, low_dim, actions)
        if isinstance(self.sampler, TrainedPolicy):
            config, low_dim = replace(config, observation=ObservationConfig(normalise=True)), self.sampler.width
        self.critics = Critics(config, self.config, low_dim, actions)

    def encode(self, observation: Observation) -> Observation:
        """The observation, or where a trained policy proposes, the features that it sees."""
        return self.sampler.encode(observation) if isinstance(self.sampler, TrainedPolicy) else observation

    def act(self, observation: Observation, memory: Any, generator: torch.Generator) -> tuple[Tensor, Any]:
        """(B, A): of the sampler's proposals the one that the first critic values most, as in robomimic; no memory."""
        observation = self.encode(observation)
        shape = (len(observation.low_dim), self.config.rollout_proposals, self.sampler.noise)
        proposals = self.sampler.propose(observation, torch.randn(shape, generator=generator))
        best = self.critics.members[0](observation, proposals).argmax(dim=1)
        return proposals[torch.arange(len(best)), best], memory


def target_values(rewards: Tensor, dones: Tensor, values: Tensor, config: BCQConfig) -> Tensor:
    """(B,): r + (1 - done) discount max over proposals of (p least + (1 - p) greatest value of the critics).

    Args:
        rewards: (B,).
        dones: (B,), 1 where nothing follows.
        values: (E, B, n) of the target critics for n proposals in the next state.
        config: discount and p, the pessimism.
    """
    mixed = config.pessimism * values.amin(dim=0) + (1 - config.pessimism) * values.amax(dim=0)
    return rewards + (1 - dones) * config.discount * mixed.amax(dim=-1)
