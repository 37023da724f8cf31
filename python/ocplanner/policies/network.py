"""Makes the network that a configuration names."""

import torch

from ocplanner.policies.actor import Actor
from ocplanner.policies.bc import BC
from ocplanner.policies.bc_rnn import BCRNN
from ocplanner.policies.bcq import BCQ
from ocplanner.policies.config import PolicyTraining

ALGORITHMS: dict[str, type[BC] | type[BCRNN] | type[BCQ]] = {"bc": BC, "bc-rnn": BCRNN, "bcq": BCQ}


def make_actor(config: PolicyTraining, low_dim: int, actions: int) -> Actor | BCQ:
    """The network with its first weights, which depend on the configuration's seed alone.

    Args:
        config: algorithm and sizes.
        low_dim: width of the low-dimensional observation, D.
        actions: width of an action, A.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        return ALGORITHMS[config.algorithm](config, low_dim, actions)
