"""What follows each recorded step: the next observation, the reward, and whether anything comes after it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ocplanner.demos.dataset import Demonstrations
from ocplanner.demos.demonstration import Demonstration
from ocplanner.errors import DatasetError
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.observation import Observation, low_dim_row


class TransitionBatch(NamedTuple):
    """B transitions.

    Attributes:
        observation: before the action.
        actions: (B, A).
        rewards: (B,) float32.
        dones: (B,) float32, 1 where nothing follows.
        next_observation: after the action; its pictures are cropped centrally, as robomimic's targets see them.
    """

    observation: Observation
    actions: Tensor
    rewards: Tensor
    dones: Tensor
    next_observation: Observation


@dataclass(frozen=True)
class Transitions:
    """What follows each of N recorded steps.

    ``done`` and reward are those of the file, as robomimic's ``SequenceDataset`` reads them: what robomimic wrote with
    ``--done_mode 2``, Square PH among it, has done = 1 at every step that leads to success (there the last five or six
    of each demonstration) and at the last one. The target of such a step is its reward alone.

    Attributes:
        next_low_dim: (N, D) float32: the file's ``next_obs``; without it the next step's ``obs``, at the end the last.
        last_images: camera -> (demonstrations, h, w, 3) uint8, after each demonstration's last step; those after other
            steps are the next step's own.
        rewards: (N,) float32.
        dones: (N,) float32.
    """

    next_low_dim: Tensor
    last_images: dict[str, np.ndarray]
    rewards: Tensor
    dones: Tensor

    def arrays(self) -> list[np.ndarray]:
        """All numbers, for a digest."""
        numbers = [self.next_low_dim, self.rewards, self.dones]
        return [*(tensor.numpy() for tensor in numbers), *self.last_images.values()]


def load_transitions(demos: Demonstrations, names: Sequence[str], config: PolicyTraining) -> Transitions:
    """Read what follows the steps of the named demonstrations, whose observations have been read and checked.

    Raises:
        DatasetError: rewards or dones are missing, or ``next_obs`` does not fit ``obs``.
    """
    chosen = [demos[name] for name in names]
    seen = config.observation
    low_dim = [low_dim_row({key: _next(demos, demo, key) for key in seen.low_dim}, seen.low_dim) for demo in chosen]
    rewards = np.concatenate([demo.rewards for demo in chosen]).astype(np.float32)
    dones = np.concatenate([demo.dones for demo in chosen]).astype(np.float32)
    return Transitions(
        torch.from_numpy(np.concatenate(low_dim)),
        {camera: np.stack([_last(demo, f"{camera}_image") for demo in chosen]) for camera in seen.cameras},
        torch.from_numpy(rewards),
        torch.from_numpy(dones),
    )


def _next(demos: Demonstrations, demo: Demonstration, key: str) -> np.ndarray:
    here = demo.observation(key)
    if key not in demo.next_observation_keys:
        return np.concatenate([here[1:], here[-1:]])
    following = demo.next_observation(key)
    if following.shape != here.shape or not np.isfinite(following).all():
        raise DatasetError(
            f"{demos.path}: {demo.name}/next_obs/{key}: expected finite numbers of shape {here.shape} as in obs; "
            "remove next_obs from the file, and the observations themselves are used"
        )
    return following


def _last(demo: Demonstration, key: str) -> np.ndarray:
    rows = np.array([demo.length - 1])
    return (demo.next_observation(key, rows) if key in demo.next_observation_keys else demo.observation(key, rows))[0]
