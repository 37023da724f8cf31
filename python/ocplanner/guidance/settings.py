"""Weights and form of the plan's reward."""

from dataclasses import dataclass
from typing import Literal, get_args

from ocplanner import _core

Form = Literal["penalty", "literal", "exp", "potential"]
RewardMode = Literal["augment", "only", "off"]
"""How the plan's reward joins the recorded one, see :class:`ocplanner.LabelSettings`."""

FORMS: tuple[str, ...] = get_args(Form)


@dataclass(frozen=True)
class RewardConfig:
    """How the weighted error E = a |p' - p|^2 + b |r' - r|^2 of a transition becomes its reward.

    Raises:
        InvalidValueError: a weight is negative, or the form's ``scale`` or ``gamma`` is outside its range.
        UnknownNameError: no such form; the message lists those there are.
    """

    a: float = 0.003
    """Weight of the position term, 1/m^2."""
    b: float = 0.003
    """Weight of the rotation term."""
    form: Form = "penalty"
    """``penalty``: -E. ``literal``: +E, the equation as the paper prints it, which rewards leaving the plan. ``exp``:
    exp(-E / scale), 1 on the plan. ``potential``: gamma Phi(s') - Phi(s) with Phi = -E, which leaves the best policy
    as it is (Ng, Harada and Russell 1999)."""
    gamma: float = 0.99
    """The learner's discount, in [0, 1]; for ``potential`` only."""
    scale: float = 2.5e-4
    """The E at which ``exp`` has fallen to 1/e; for ``exp`` only. The default is what the default weights make of 2 cm
    and 0.2 rad together. With these weights 0.2 rad count 200 times as much as 2 cm: for an even share raise ``a``, for
    instance ``a=1 / 0.02**2, b=1 / 0.2**2, scale=1``."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        _ = self.law

    @property
    def law(self) -> _core.RewardLaw:
        """The native reward of this configuration."""
        return _core.RewardLaw(
            self.form, weight_position=self.a, weight_rotation=self.b, scale=self.scale, gamma=self.gamma
        )
