"""The length of a stage of training, and its learning rate."""

import math
from dataclasses import dataclass
from typing import Literal

from ocplanner.settings import require

Schedule = Literal["constant", "cosine"]


@dataclass(frozen=True)
class StageConfig:
    """One stage of training: AdamW, linear warm-up, cosine decay, averaged weights."""

    steps: int
    batch: int = 64
    """Frames a step."""
    learning_rate: float = 1e-3
    """The highest learning rate, after the warm-up."""
    weight_decay: float = 1e-4
    """AdamW's weight decay."""
    warmup: int = 100
    """Steps in which the learning rate rises to its highest."""
    ema: float = 0.999
    """Decay of the moving average of the weights, which later stages and the planner use; 0: no average."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require(self.steps >= 0 and self.batch >= 1, f"steps {self.steps} and batch {self.batch} must be positive")
        require(self.learning_rate > 0, f"learning rate {self.learning_rate} must be positive")
        require(self.weight_decay >= 0 and self.warmup >= 0, "weight decay and warm-up must not be negative")
        require(0 <= self.ema < 1, f"ema {self.ema} must lie in [0, 1)")


def learning_rate(step: int, *, base: float, steps: int, warmup: int, schedule: Schedule = "cosine") -> float:
    """The learning rate of a step: linear warm-up, then constant or a cosine to zero at the last step.

    Args:
        step: counted from 0.
        base: the rate before warm-up and schedule.
        steps: number of steps of the training.
        warmup: number of steps of the warm-up.
        schedule: what follows the warm-up.
    """
    warm = min(1.0, (step + 1) / max(1, warmup))
    decay = 1.0 if schedule == "constant" else 0.5 * (1 + math.cos(math.pi * step / steps))
    return base * warm * decay
