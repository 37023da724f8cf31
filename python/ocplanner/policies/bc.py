"""Behaviour cloning: layers on one observation, and a Gaussian mixture over the action."""

import itertools

import torch
from torch import Tensor, nn

from ocplanner.policies.actor import Actor, Memory
from ocplanner.policies.algorithms import Algorithm
from ocplanner.policies.config import ObservationKind, PolicyTraining, Preset, cpu_preset, robomimic_preset
from ocplanner.policies.imitation import Imitation


class BC(Actor):
    """robomimic's BC: ReLU after every layer."""

    def __init__(self, config: PolicyTraining, low_dim: int, actions: int) -> None:
        super().__init__(config, low_dim)
        widths = (self.encoder.features, *config.network.hidden)
        self.layers = nn.ModuleList([nn.Linear(i, o) for i, o in itertools.pairwise(widths)])
        self.add_head(widths[-1], actions)

    def features(self, encoded: Tensor, memory: Memory | None) -> tuple[Tensor, Memory | None]:
        """(..., F) for (..., E); nothing is remembered."""
        for layer in self.layers:
            encoded = torch.relu(layer(encoded))
        return encoded, memory


def _preset(name: Preset, kind: ObservationKind) -> PolicyTraining:
    if name == "robomimic":
        return robomimic_preset("bc", kind)
    return cpu_preset("bc", kind, steps=20_000, batch=100 if kind == "state" else 64)


ALGORITHM = Algorithm(BC, Imitation, _preset)
