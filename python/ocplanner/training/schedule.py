"""How long a stage of training lasts, and its learning-rate curve."""

import math
from dataclasses import dataclass

from ocplanner.settings import require


@dataclass(frozen=True)
class StageConfig:
    """One stage of training: AdamW, linear warm-up, cosine decay, averaged weights."""

    steps: int
    batch: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    warmup: int = 100
    ema: float = 0.999
    """Decay of the moving average of the weights, which is what later stages and the planner use; 0: off."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require(self.steps >= 0 and self.batch >= 1, f"steps {self.steps} and batch {self.batch} must be positive")
        require(self.learning_rate > 0, f"learning rate {self.learning_rate} must be positive")
        require(self.weight_decay >= 0 and self.warmup >= 0, "weight decay and warm-up must not be negative")
        require(0 <= self.ema < 1, f"ema {self.ema} must lie in [0, 1)")


def learning_rate(config: StageConfig, step: int) -> float:
    """Linear warm-up, then a cosine to zero at the stage's last step."""
    warm = min(1.0, (step + 1) / max(1, config.warmup))
    return config.learning_rate * warm * 0.5 * (1 + math.cos(math.pi * step / config.steps))
