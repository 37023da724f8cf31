"""What ``ocplanner label`` writes, and the weights and the form of the plan's reward."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from ocplanner import _core
from ocplanner.errors import DatasetError
from ocplanner.files.records.labels import LabelRecord
from ocplanner.settings import build, require, require_choice

Form = Literal["penalty", "literal", "exp", "potential"]
Origin = Literal["object", "plan"]
RewardMode = Literal["augment", "only", "off"]


@dataclass(frozen=True)
class RewardConfig:
    """How the weighted error E = a |p' - p|^2 + b |r' - r|^2 of a transition becomes its reward.

    ``literal`` rewards leaving the plan. ``exp`` is 1 on the plan. ``potential`` is gamma Phi(s') - Phi(s) with
    Phi = -E, which leaves the best policy unchanged (Ng, Harada and Russell 1999).

    The default ``scale`` is the E of 2 cm and 0.2 rad together under the default weights, which count 0.2 rad 200 times
    as much as 2 cm. For an even share use, for instance, ``a=1 / 0.02**2, b=1 / 0.2**2, scale=1``.

    Raises:
        InvalidValueError: a weight is negative, or the form's ``scale`` or ``gamma`` is outside its range.
        UnknownNameError: no such form; the message lists the known ones.
    """

    a: float = 0.003
    """Weight of the position term, 1/m^2."""
    b: float = 0.003
    """Weight of the rotation term."""
    form: Form = "penalty"
    """penalty: -E. literal: +E, as the paper prints it. exp: exp(-E / scale). potential: shaping by Phi = -E."""
    gamma: float = 0.99
    """The learner's discount, in [0, 1]; for the form potential only."""
    scale: float = 2.5e-4
    """The weighted error E at which the form exp has fallen to 1/e."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        _ = self.law

    @property
    def law(self) -> _core.RewardLaw:
        """The native reward of this configuration."""
        return _core.RewardLaw(
            self.form, weight_position=self.a, weight_rotation=self.b, scale=self.scale, gamma=self.gamma
        )


@dataclass(frozen=True)
class LabelSettings:
    """What is written into a labelled data set.

    Raises:
        InvalidValueError: nothing to write, or a number is out of range.
        UnknownNameError: no such mode or origin; the message lists the known ones.
    """

    hints: bool = True
    """Write obs/ocp_hint and obs/ocp_plan."""
    horizon_steps: Annotated[tuple[int, ...], tyro.conf.arg(name="horizon-step")] = (1,)
    """Planned steps that hints point to: 1 is the next, the paper's choice; several are stacked."""
    hint_from: Origin = "object"
    """Where hints start: at the object's real pose, or at the plan's first step."""
    reward: RewardMode = "off"
    """Add the plan's reward to the recorded one, put it in its place, or leave rewards alone."""
    reward_config: Annotated[RewardConfig, tyro.conf.arg(name="")] = field(default_factory=RewardConfig)
    """Weights and form of the plan's reward."""
    batch: int = 64
    """Images planned at a time."""
    threads: int = 1
    """Threads of the planner; not recorded, since labels depend on it only by rounding."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("reward mode", self.reward, RewardMode)
        require_choice("origin of hints", self.hint_from, Origin)
        something = self.hints or self.reward != "off"
        require(something, "neither hints nor rewards: nothing to write; choose --reward augment or only")
        steps = self.horizon_steps
        distinct = len(steps) > 0 and len(set(steps)) == len(steps)
        require(distinct, f"horizon steps {steps}: name each planned step once, 1 for the next")
        require(self.batch >= 1, f"batch must be at least 1, not {self.batch}")
        require(self.threads >= 1, f"threads must be at least 1, not {self.threads}")

    @classmethod
    def of(cls, record: LabelRecord) -> "LabelSettings":
        """The settings that a labelled data set, or a policy trained on it, was made with.

        Raises:
            DatasetError: a setting is missing or wrong; the message names it.
        """
        try:
            return build(cls, record.settings, ignore_unknown=True)
        except ValueError as error:
            raise DatasetError(
                f"the settings of labels cannot be read: {error}; label the data set again with `ocplanner label`"
            ) from error
