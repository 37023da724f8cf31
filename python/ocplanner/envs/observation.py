"""What a picture shows of the robot."""

from typing import Literal, get_args

Observe = Literal["full", "masked", "no-robot"]
"""``full``: everything. ``masked``: the robot in one colour wherever it is seen. ``no-robot``: the robot left out."""

OBSERVE_MODES: tuple[str, ...] = get_args(Observe)
