"""Names that settings choose from, apart so that naming them loads neither simulation nor torch."""

from typing import Literal

Flaw = Literal["early-release", "misjudged-goal"]
"""How an expert fails, see :func:`ocplanner.demos.flawed.fail`."""
Form = Literal["penalty", "literal", "exp", "potential"]
"""Of the plan's reward, see :class:`ocplanner.RewardConfig`."""
RewardMode = Literal["augment", "only", "off"]
"""How the plan's reward joins the recorded one, see :class:`ocplanner.LabelSettings`."""
