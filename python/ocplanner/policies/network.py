"""What every policy's network does, and how it gets its first weights."""

from typing import Any

import torch
from torch import Tensor, nn

from ocplanner.policies.algorithms import find_algorithm
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.observation import Observation


class PolicyNetwork(nn.Module):
    """A network that acts; what a policy file holds."""

    def act(self, observation: Observation, memory: Any, generator: torch.Generator) -> tuple[Tensor, Any]:
        """Actions for one step of B environments.

        Args:
            observation: of B environments.
            memory: what the last call of the episode gave; None at its start.
            generator: of what is drawn.

        Returns:
            (B, A) actions, and the memory for the next step.
        """
        raise NotImplementedError


def make_network(config: PolicyTraining, low_dim: int, actions: int) -> PolicyNetwork:
    """The network of a configuration. Its first weights depend on the configuration's seed alone.

    Args:
        config: algorithm and sizes.
        low_dim: width of the low-dimensional observation, D.
        actions: width of an action, A.
    """
    with torch.random.fork_rng(devices=[]):  # the program's own random numbers stay as they are
        torch.manual_seed(config.seed)
        return find_algorithm(config.algorithm).network(config, low_dim, actions)
