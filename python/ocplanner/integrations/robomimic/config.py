"""robomimic's BC configuration with a section for the hint."""

from pathlib import Path
from typing import Any

from robomimic.config import BCConfig

from ocplanner.demos.dataset import Demonstrations
from ocplanner.errors import InvalidValueError, MismatchError
from ocplanner.policies.config import HINT_KEY, HintConfig
from ocplanner.policies.data import hint_horizons
from ocplanner.settings import require


class HintedBCConfig(BCConfig):
    """``algo.ocp_hint`` beside robomimic's own sections; robomimic registers it as ``bc`` when it is defined.

    ``enabled`` (False), ``horizons`` ([1]) and ``initial_weight`` (1.0): see
    :class:`ocplanner.policies.config.HintConfig`.
    """

    ALGO_NAME = "bc"

    def algo_config(self) -> None:
        """Fill ``algo``; robomimic then locks its keys."""
        super().algo_config()
        self.algo.ocp_hint.enabled = False
        self.algo.ocp_hint.horizons = [1]
        self.algo.ocp_hint.initial_weight = HintConfig.initial_weight

    def lock(self) -> None:
        """Close the configuration, as robomimic's ``train.py`` does before it does anything else.

        Raises:
            InvalidValueError: a horizon is outside its domain, or there is no mixture to shift.
            MismatchError: the hint is on together with rollouts or scaled numbers, or with other horizons than the
                data set's.
        """
        super().lock()
        hint = hint_config(self.algo)
        if hint is not None:
            _check(self, hint)


def hint_config(algo: Any) -> HintConfig | None:
    """The hint that an ``algo`` section asks for, or None; robomimic's HBC has sections without ``ocp_hint``.

    Raises:
        InvalidValueError: a horizon is outside its domain.
    """
    if "ocp_hint" not in algo or not algo.ocp_hint.enabled:
        return None
    horizons = tuple(algo.ocp_hint.horizons)
    require(len(horizons) > 0, "algo.ocp_hint.horizons is empty: name the horizons that the data set was labelled with")
    return HintConfig(horizons, algo.ocp_hint.initial_weight)


def require_mixture(algo: Any) -> None:
    """The hint shifts a mixture's means.

    Raises:
        InvalidValueError: the ``algo`` section asks for something else than a mixture.
    """
    if not algo.gmm.enabled or algo.gaussian.enabled or algo.transformer.enabled:
        raise InvalidValueError(
            "algo.ocp_hint.enabled shifts the means of a Gaussian mixture: set algo.gmm.enabled, and switch "
            "algo.gaussian and algo.transformer off; or read ocp_hint as an observation, with algo.ocp_hint off"
        )


def _check(config: BCConfig, hint: HintConfig) -> None:
    require_mixture(config.algo)
    if config.experiment.rollout.enabled:
        raise MismatchError(
            f"robomimic's environments observe no {HINT_KEY!r}, so that its rollouts would fail: "
            "set experiment.rollout.enabled to false, and export the checkpoint for `ocplanner evaluate`"
        )
    scaled = [key for key, about in config.train.action_config.items() if about.get("normalization") is not None]
    if config.train.hdf5_normalize_obs or scaled:
        raise MismatchError(
            "the hint is in the units of the recorded action: set train.hdf5_normalize_obs to false and the "
            "normalization of every train.action_config to null"
        )
    data = config.train.data
    for entry in [{"path": data}] if isinstance(data, str) else data or []:
        if Path(entry["path"]).is_file():
            with Demonstrations(entry["path"]) as demos:
                hint_horizons(demos, hint.horizons, "algo.ocp_hint.horizons")
