"""What ``ocplanner label`` writes."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from ocplanner.errors import DatasetError
from ocplanner.files.records.labels import LabelRecord
from ocplanner.guidance.rewards import RewardConfig
from ocplanner.settings import build, require, require_choice

Origin = Literal["object", "plan"]
RewardMode = Literal["augment", "only", "off"]


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
