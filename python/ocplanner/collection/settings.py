"""What is collected, apart from the code that does it: naming these loads neither simulation nor torch."""

from typing import Literal

Flaw = Literal["early-release", "misjudged-goal"]
"""How an expert fails, see :func:`ocplanner.collection.flawed.fail`."""
