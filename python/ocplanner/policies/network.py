"""Makes the network that a configuration names."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from ocplanner.policies.actor import Actor
from ocplanner.policies.bc import BC
from ocplanner.policies.bc_rnn import BCRNN
from ocplanner.policies.bcq import BCQ
from ocplanner.policies.config import PolicyTraining

IMITATION: dict[str, type[BC] | type[BCRNN]] = {"bc": BC, "bc-rnn": BCRNN}


def make_network(config: PolicyTraining, low_dim: int, actions: int) -> Actor | BCQ:
    """The network with its first weights, which depend on the configuration's seed alone.

    Args:
        config: algorithm and sizes.
        low_dim: width of the low-dimensional observation, D.
        actions: width of an action, A.
    """
    return make_bcq(config, low_dim, actions) if config.algorithm == "bcq" else make_actor(config, low_dim, actions)


def make_actor(config: PolicyTraining, low_dim: int, actions: int) -> Actor:
    """:func:`make_network` for algorithms that imitate."""
    with _seeded(config.seed):
        return IMITATION[config.algorithm](config, low_dim, actions)


def make_bcq(config: PolicyTraining, low_dim: int, actions: int) -> BCQ:
    """:func:`make_network` for BCQ."""
    with _seeded(config.seed):
        return BCQ(config, low_dim, actions)


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """The program's own random numbers stay as they are."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        yield
