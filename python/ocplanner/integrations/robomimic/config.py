"""robomimic's BC configuration with a section for the hint."""

from typing import Any

from robomimic.config import BCConfig

from ocplanner.policies.config import HintConfig


class HintedBCConfig(BCConfig):
    """``algo.ocp_hint`` beside robomimic's own sections; robomimic registers it as ``bc`` when it is defined.

    ``enabled`` (False), ``horizons`` ([1]) and ``initial_weight`` (1.0): see
    :class:`ocplanner.policies.config.HintConfig`.
    """

    ALGO_NAME = "bc"

    def algo_config(self) -> None:
        """Fill ``algo``; robomimic then locks its keys."""
        super().algo_config()
        default = HintConfig()
        self.algo.ocp_hint.enabled = False
        self.algo.ocp_hint.horizons = list(default.horizons)
        self.algo.ocp_hint.initial_weight = default.initial_weight


def hint_config(algo: Any) -> HintConfig | None:
    """The hint that an ``algo`` section asks for, or None; robomimic's HBC has sections without ``ocp_hint``.

    Raises:
        InvalidValueError: a horizon is outside its domain.
    """
    if "ocp_hint" not in algo or not algo.ocp_hint.enabled:
        return None
    return HintConfig(tuple(algo.ocp_hint.horizons), algo.ocp_hint.initial_weight)
