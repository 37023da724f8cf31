"""What the training loop asks of an algorithm."""

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np
from torch import Tensor

from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.data import Samples
from ocplanner.policies.network import PolicyNetwork

EVALUATION_BATCH = 256
"""Samples at a time where nothing is learned."""


class Learner(Protocol):
    """An algorithm in training: a network, its losses and its optimisers; one in each process."""

    @property
    def network(self) -> PolicyNetwork:
        """What a policy file holds."""
        ...

    def step(self, samples: Samples, rows: np.ndarray, step: int) -> dict[str, Tensor]:
        """Learn from the whole batch's ``rows``, of which each process takes its share.

        Returns:
            What is reported, each a number averaged over the share: ``loss`` first, then whatever else there is to see.
        """
        ...

    def held_out(self, samples: Samples) -> dict[str, float]:
        """The same on held-out samples, with central crops and nothing that is random from one call to the next."""
        ...

    def swap(self) -> None:
        """Exchange the network's weights and their average, if one is kept; calling it twice changes nothing."""
        ...

    def state(self) -> Iterator[tuple[str, Tensor]]:
        """Names and tensors of all that a resumed run needs beside the network."""
        ...

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over what :meth:`state` gave."""
        ...


def crops(config: PolicyTraining, step: int, process: int) -> np.random.Generator:
    """Places the crops of a step's pictures."""
    return np.random.default_rng([config.seed, 1, step, process])
