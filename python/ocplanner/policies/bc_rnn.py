"""Behaviour cloning with memory: an LSTM over the observations, and a Gaussian mixture at every step."""

from typing import Any

import torch
from torch import Tensor, nn

from ocplanner.policies.actor import Actor, Memory
from ocplanner.policies.algorithms import Algorithm
from ocplanner.policies.config import ObservationKind, PolicyTraining, Preset, cpu_preset, robomimic_preset
from ocplanner.policies.imitation import Imitation
from ocplanner.policies.observation import Observation


class BCRNN(Actor):
    """robomimic's BC-RNN: the LSTM reads the encoded observations and the mixture its outputs; no layers after it."""

    def __init__(self, config: PolicyTraining, low_dim: int, actions: int) -> None:
        super().__init__(config, low_dim)
        network = config.network
        self.lstm = nn.LSTM(self.encoder.features, network.lstm_hidden, network.lstm_layers)
        self.add_head(network.lstm_hidden, actions)

    def features(self, encoded: Tensor, memory: Memory | None) -> tuple[Tensor, Memory | None]:
        """(T, B, F) for (T, B, E), and the memory (hidden and cell state, each (layers, B, F)) after the last step."""
        return self.lstm(encoded, memory)

    def act(self, observation: Observation, memory: Any, generator: torch.Generator) -> tuple[Tensor, Any]:
        """As every network; the memory is the LSTM's state and how many steps it has seen.

        It is forgotten after as many steps as a training sequence has, as robomimic's is.
        """
        state, steps = (None, 0) if memory is None or memory[1] == self.config.network.sequence else memory
        images = {name: image[None] for name, image in observation.images.items()}
        hint = None if observation.hint is None else observation.hint[None]
        mixture, state = self.distribution(Observation(observation.low_dim[None], images, hint), state)
        return mixture.sample(self.config.network.gmm.low_noise, generator)[0], (state, steps + 1)


def _preset(name: Preset, kind: ObservationKind) -> PolicyTraining:
    if name == "robomimic":
        return robomimic_preset("bc-rnn", kind)
    steps, batch = (20_000, 100) if kind == "state" else (12_000, 16)
    return cpu_preset("bc-rnn", kind, steps, batch, learning_rate=1e-3)


ALGORITHM = Algorithm(BCRNN, Imitation, _preset, sequences=True)
