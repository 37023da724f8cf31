"""Behaviour cloning with memory: an LSTM over the observations, and a Gaussian mixture at every step."""

from torch import Tensor, nn

from ocplanner.policies.actor import Actor, Memory
from ocplanner.policies.config import PolicyTraining


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
