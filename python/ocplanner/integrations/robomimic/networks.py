"""robomimic's actors with a Gaussian mixture, whose means are the weighted hint plus the residual."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from robomimic.models.obs_nets import MIMO_MLP, RNN_MIMO_MLP
from robomimic.models.policy_nets import GMMActorNetwork, RNNGMMActorNetwork
from robomimic.utils import tensor_utils
from torch import Tensor, distributions, nn

from ocplanner.policies.config import HINT_KEY, HintConfig
from ocplanner.policies.gmm import LOW_NOISE_STD
from ocplanner.policies.hint import displacements, shifted

_WEIGHTS = "hint_weights"


class HintedGMMActor(GMMActorNetwork):
    """BC's actor. The hint does not enter the encoder: it only shifts the means, as in the paper's Figure 9."""

    def __init__(self, hint: HintConfig, **settings: Any) -> None:
        self.hint = hint
        super().__init__(**settings)
        _add_weights(self)

    def forward_train(
        self, obs_dict: Mapping[str, Tensor], goal_dict: Mapping[str, Tensor] | None = None
    ) -> distributions.MixtureSameFamily:
        """The mixture over actions (B, A) for observations (B, ...)."""
        return _mixture(self, MIMO_MLP.forward(self, obs=obs_dict, goal=goal_dict), obs_dict[HINT_KEY])


class HintedRNNGMMActor(RNNGMMActorNetwork):
    """BC-RNN's actor; see :class:`HintedGMMActor`."""

    def __init__(self, hint: HintConfig, **settings: Any) -> None:
        self.hint = hint
        super().__init__(**settings)
        _add_weights(self)

    def forward_train(
        self,
        obs_dict: Mapping[str, Tensor],
        goal_dict: Any = None,
        rnn_init_state: Any = None,
        return_state: bool = False,
    ) -> Any:
        """The mixtures over actions (B, T, A) for observations (B, T, ...), and the LSTM's state if asked for."""
        if self._is_goal_conditioned:
            goal_dict = tensor_utils.unsqueeze_expand_at(goal_dict, size=obs_dict[HINT_KEY].shape[1], dim=1)
        done: Any = RNN_MIMO_MLP.forward(
            self, obs=obs_dict, goal=goal_dict, rnn_init_state=rnn_init_state, return_state=return_state
        )
        outputs, state = done if return_state else (done, None)
        mixture = _mixture(self, outputs, obs_dict[HINT_KEY])
        return (mixture, state) if return_state else mixture


Actor = HintedGMMActor | HintedRNNGMMActor


def _add_weights(actor: Actor) -> None:
    # Drawn after all others, so that an actor with a hint starts from the same others as one without.
    decoder: Any = actor.nets["decoder"]
    shape = (actor.num_modes, len(actor.hint.horizons), 2)
    decoder.obs_shapes[_WEIGHTS] = shape
    decoder.nets[_WEIGHTS] = nn.Linear(decoder.input_feat_dim, math.prod(shape))


def _mixture(actor: Actor, outputs: Mapping[str, Tensor], hint: Tensor) -> distributions.MixtureSameFamily:
    """What robomimic's ``forward_train`` makes of the decoder's outputs, with shifted means."""
    weights = outputs[_WEIGHTS] + actor.hint.initial_weight
    means = shifted(torch.tanh(outputs["mean"]), weights, displacements(hint, actor.hint))
    if actor.low_noise_eval and not actor.training:
        stds = torch.full_like(means, LOW_NOISE_STD)
    else:
        stds = actor.activations[actor.std_activation](outputs["scale"]) + actor.min_std
    return distributions.MixtureSameFamily(
        distributions.Categorical(logits=outputs["logits"]),
        distributions.Independent(distributions.Normal(means, stds), 1),
    )
