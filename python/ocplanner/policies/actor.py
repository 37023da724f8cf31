"""What all imitation algorithms share: observations in, a mixture over actions out, and the loss."""

from typing import Any

import torch
from torch import Tensor

from ocplanner.errors import MismatchError
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.gmm import GmmHead, Mixture
from ocplanner.policies.hint import HintWeights, residual_motion
from ocplanner.policies.network import PolicyNetwork
from ocplanner.policies.observation import Observation, ObservationEncoder

Memory = tuple[Tensor, Tensor]
"""State of an LSTM."""


class Actor(PolicyNetwork):
    """An observation encoder, an algorithm's own layers, and a mixture head with or without the hint."""

    head: GmmHead
    hint: HintWeights | None

    def __init__(self, config: PolicyTraining, low_dim: int) -> None:
        super().__init__()
        self.config = config
        self.encoder = ObservationEncoder(config.observation, low_dim)

    def add_head(self, features: int, actions: int) -> None:
        """Finish the network; an algorithm calls it after its own layers.

        The hint's weights are drawn last, so that a policy with a hint starts from the same others as one without.
        """
        network = self.config.network
        self.head = GmmHead(features, actions, network.gmm)
        self.hint = None if network.hint is None else HintWeights(features, network.gmm.modes, network.hint)

    def features(self, encoded: Tensor, memory: Memory | None) -> tuple[Tensor, Memory | None]:
        """The algorithm's layers."""
        raise NotImplementedError

    def distribution(self, observation: Observation, memory: Memory | None = None) -> tuple[Mixture, Memory | None]:
        """The mixture over actions at every step, and the memory after the last."""
        _, mixture, memory = self._mixtures(observation, memory)
        return mixture, memory

    def _mixtures(self, observation: Observation, memory: Memory | None) -> tuple[Mixture, Mixture, Memory | None]:
        """The residual's mixture, the one over actions (the same without a hint), and the memory."""
        features, memory = self.features(self.encode(observation), memory)
        # A mixture with deviations down to 1e-4 needs means that bfloat16 cannot hold.
        with torch.autocast(features.device.type, enabled=False):
            features = features.float()
            residual = self.head(features)
            if self.hint is None:
                return residual, residual, memory
            if observation.hint is None:
                raise MismatchError("the policy reads a hint, and the observation holds none; give `ocp_hint`")
            return residual, self.hint(residual, features, observation.hint), memory

    def encode(self, observation: Observation) -> Tensor:
        """(..., E) what the algorithm's layers read; without pictures where the plan stands for them."""
        config = self.config.network.hint
        if config is None or not config.instead_of_pictures or observation.hint is None:
            return self.encoder(observation)
        return self.encoder(observation, observation.hint[..., -1] > 0.5)

    def act(self, observation: Observation, memory: Any, generator: torch.Generator) -> tuple[Tensor, Any]:
        """(B, A) actions drawn from the mixture; see :class:`ocplanner.policies.network.PolicyNetwork`."""
        mixture, memory = self.distribution(observation, memory)
        return mixture.sample(self.config.network.gmm.low_noise, generator), memory

    def forward(self, observation: Observation, actions: Tensor) -> Tensor:
        """Mean negative log-likelihood of recorded actions (..., A), padded steps included as in robomimic.

        In training the residual's penalty is added, if the hint's configuration asks for one.
        """
        residual, mixture, _ = self._mixtures(observation, None)
        loss = -mixture.log_likelihood(actions).mean()
        hint = self.config.network.hint
        if self.training and hint is not None and hint.residual_penalty > 0 and observation.hint is not None:
            loss = loss + hint.residual_penalty * residual_motion(residual, observation.hint)
        return loss

    def __call__(self, *args: Any, **kwargs: Any) -> Tensor:
        """See :meth:`forward`."""
        return super().__call__(*args, **kwargs)
