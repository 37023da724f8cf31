"""What the critics of BCQ think of recorded episodes."""

import numpy as np
import torch

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import MismatchError
from ocplanner.policies.bcq_network import BCQ
from ocplanner.policies.converted_episode import load_episode
from ocplanner.policies.data import Samples
from ocplanner.policies.learner import EVALUATION_BATCH
from ocplanner.policies.policy import Policy


def q_values(policy: Policy, demos: Demonstrations, name: str) -> np.ndarray:
    """(E, T) float32: Q(s_t, a_t) of each of E critics for the recorded actions of an episode of T steps.

    The first critic is the one that acts. Rewards and dones of the episode are not read, so it may have none; and it
    may be of another robosuite version, see :func:`ocplanner.policies.converted_episode.load_episode`. To ask several
    policies about one episode, load it once and give it to :func:`values_of`.

    Args:
        policy: trained by BCQ.
        demos: a data set with the observations that the policy sees, held out or not.
        name: the demonstration.

    Raises:
        MismatchError: the policy has no critics, or the episode is of another task or kind of actions.
        DatasetError: an observation is missing or of another size.
    """
    _critics(policy)
    return values_of(policy, load_episode(policy, demos, name))


def values_of(policy: Policy, samples: Samples) -> np.ndarray:
    """(E, T) float32: as :func:`q_values`, of an episode that was loaded for this policy or another of its training.

    Raises:
        MismatchError: the policy has no critics.
    """
    network, config = _critics(policy), policy.training
    values = []
    with torch.inference_mode():
        for start in range(0, len(samples), EVALUATION_BATCH):
            rows = np.arange(start, min(start + EVALUATION_BATCH, len(samples)))
            observation, actions = samples.batch(rows, config, torch.device("cpu"), None)
            values.append(network.critics.values(network.encode(observation), actions))
    return torch.cat(values, dim=1).numpy()


def _critics(policy: Policy) -> BCQ:
    network, algorithm = policy.network, policy.training.algorithm
    if not isinstance(network, BCQ):
        raise MismatchError(f"{policy.path} was trained by {algorithm}, which has no critics; train one with bcq")
    return network
