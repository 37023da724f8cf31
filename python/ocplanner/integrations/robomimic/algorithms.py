"""robomimic's BC and BC-RNN with a Gaussian mixture, reading the hint; and the factory that chooses them."""

from collections import OrderedDict
from typing import Any

from robomimic.algo import register_algo_factory_func
from robomimic.algo.algo import algo_name_to_factory_func
from robomimic.algo.bc import BC_GMM, BC_RNN_GMM
from robomimic.config.config import Config
from robomimic.models.base_nets import rnn_args_from_config
from robomimic.utils.obs_utils import obs_encoder_kwargs_from_config
from torch import Tensor, nn

from ocplanner.errors import MismatchError
from ocplanner.integrations.robomimic.config import hint_config, require_mixture
from ocplanner.integrations.robomimic.networks import HintedGMMActor, HintedRNNGMMActor
from ocplanner.policies.config import HINT_KEY, HintConfig

_robomimics_own = algo_name_to_factory_func("bc")


def algorithm_of(algo: Config) -> tuple[type[Any], dict[str, Any]]:
    """The class that an ``algo`` section asks for, and further arguments for it.

    Raises:
        InvalidValueError: the hint is on where there is no mixture to shift, or a horizon is outside its domain.
    """
    if hint_config(algo) is None:
        return _robomimics_own(algo)
    require_mixture(algo)
    return (HintedBCRNN if algo.rnn.enabled else HintedBC), {}


# As a decorator it would leave None under the function's name.
register_algo_factory_func("bc")(algorithm_of)


class HintedBC(BC_GMM):
    """BC whose mixture's means are (x, y) * hint + A."""

    def _create_networks(self) -> None:
        self.nets = nn.ModuleDict({"policy": HintedGMMActor(**_settings(self))}).float().to(self.device)

    def get_action(self, obs_dict: dict[str, Tensor], goal_dict: dict[str, Tensor] | None = None) -> Tensor:
        """(B, A) actions, clipped to [-1, 1]: hint and residual together may be larger."""
        return super().get_action(obs_dict, goal_dict).clamp(-1, 1)


class HintedBCRNN(BC_RNN_GMM):
    """BC-RNN whose mixtures' means are (x, y) * hint + A."""

    def _create_networks(self) -> None:
        rnn = self.algo_config.rnn
        self._rnn_horizon, self._rnn_is_open_loop = rnn.horizon, rnn.get("open_loop", False)
        self.reset()
        settings = {**_settings(self), **rnn_args_from_config(rnn)}
        actor = HintedRNNGMMActor(**settings)
        self.nets = nn.ModuleDict({"policy": actor}).float().to(self.device)

    def get_action(self, obs_dict: dict[str, Tensor], goal_dict: dict[str, Tensor] | None = None) -> Tensor:
        """(B, A) actions, clipped to [-1, 1]: hint and residual together may be larger."""
        return super().get_action(obs_dict, goal_dict).clamp(-1, 1)


def _settings(algorithm: BC_GMM | BC_RNN_GMM) -> dict[str, Any]:
    """Arguments for either network.

    Raises:
        MismatchError: the hint is not observed, or not as wide as its horizons need.
    """
    hint = hint_config(algorithm.algo_config) or HintConfig()
    _check(algorithm, hint)
    gmm = algorithm.algo_config.gmm
    return {
        "hint": hint,
        "obs_shapes": OrderedDict((key, shape) for key, shape in algorithm.obs_shapes.items() if key != HINT_KEY),
        "goal_shapes": algorithm.goal_shapes,
        "ac_dim": algorithm.ac_dim,
        "mlp_layer_dims": algorithm.algo_config.actor_layer_dims,
        "num_modes": gmm.num_modes,
        "min_std": gmm.min_std,
        "std_activation": gmm.std_activation,
        "low_noise_eval": gmm.low_noise_eval,
        "encoder_kwargs": obs_encoder_kwargs_from_config(algorithm.obs_config.encoder),
    }


def _check(algorithm: BC_GMM | BC_RNN_GMM, hint: HintConfig) -> None:
    shape = tuple(algorithm.obs_shapes.get(HINT_KEY, ()))
    if not shape:
        raise MismatchError(
            f"algo.ocp_hint.enabled needs {HINT_KEY!r} in observation.modalities.obs.low_dim, and a data set that has "
            "it: make a copy with `ocplanner label`"
        )
    if shape != (hint.width,):
        raise MismatchError(
            f"obs/{HINT_KEY} has shape {shape} a step, and algo.ocp_hint.horizons {list(hint.horizons)} need "
            f"({hint.width},): give the horizons that the data set was labelled with"
        )
