"""The optimiser of one stage, with learning-rate schedule and averaged weights; its state is plain tensors."""

from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from ocplanner.settings import require

CLIP = 10.0
"""Largest norm of a planner's gradient."""


class OptimisationConfig(Protocol):
    """What :class:`Optimisation` reads of a configuration."""

    @property
    def learning_rate(self) -> float:
        """The rate before any schedule."""
        ...

    @property
    def weight_decay(self) -> float:
        """AdamW's weight decay; 0 gives Adam."""
        ...

    @property
    def ema(self) -> float:
        """Decay of the averaged weights; 0: no average."""
        ...


_ALWAYS_ALLOWED = 1024
"""A batch of so many may be drawn from fewer samples, which then count several times."""


class BatchOrder:
    """The frames that each step reads: a new permutation in each epoch, determined by (seed, step) alone.

    Raises:
        InvalidValueError: the batch is far larger than what there is.
    """

    def __init__(self, count: int, batch: int, seed: tuple[int, ...]) -> None:
        most = max(count, _ALWAYS_ALLOWED)
        require(batch <= most, f"batch is {batch}, but there are {count} samples to learn from: give at most {most}")
        self.count, self.batch, self.seed = count, batch, seed
        self._epoch: tuple[int, np.ndarray] | None = None

    def rows(self, step: int) -> np.ndarray:
        """The row numbers of a step, (batch,)."""
        places = np.arange(step * self.batch, (step + 1) * self.batch)
        epochs = places // self.count
        pieces = [self._permutation(int(epoch))[places[epochs == epoch] % self.count] for epoch in np.unique(epochs)]
        return np.concatenate(pieces)

    def _permutation(self, epoch: int) -> np.ndarray:
        if self._epoch is None or self._epoch[0] != epoch:
            self._epoch = (epoch, np.random.default_rng([*self.seed, epoch]).permutation(self.count))
        return self._epoch[1]


class Optimisation:
    """AdamW on a module, and a moving average of its parameters and floating-point buffers.

    Args:
        module: the module to train.
        config: learning rate, weight decay and decay of the average.
        rate: maps a step to its learning rate.
        clip: largest norm of the gradient; None: no limit.
    """

    def __init__(
        self,
        module: nn.Module,
        config: OptimisationConfig,
        rate: Callable[[int], float],
        clip: float | None = CLIP,
    ) -> None:
        self.module, self.config, self._rate, self._clip = module, config, rate, clip
        self.parameters = list(module.parameters())
        fused = all(parameter.device.type in ("cpu", "cuda") for parameter in self.parameters)
        self._adam = torch.optim.AdamW(
            self.parameters, lr=config.learning_rate, weight_decay=config.weight_decay, fused=fused
        )
        self._live = self.parameters + [b for b in module.buffers() if b.is_floating_point()]
        self._average = [tensor.detach().clone() for tensor in self._live] if config.ema > 0 else []

    def step(self, loss: Tensor, step: int, backward: Callable[[Tensor], None] = Tensor.backward) -> None:
        """Update the module once; ``backward`` computes the gradients of the loss."""
        for group in self._adam.param_groups:
            group["lr"] = self._rate(step)
        self._adam.zero_grad(set_to_none=True)
        backward(loss)
        if self._clip is not None:
            torch.nn.utils.clip_grad_norm_(self.parameters, self._clip)
        self._adam.step()
        decay = min(self.config.ema, (1 + step) / (10 + step))
        with torch.no_grad():
            for average, live in zip(self._average, self._live):
                average.lerp_(live, 1 - decay)

    def swap(self) -> None:
        """Exchange the live weights and their average, if there is one; a second call undoes the first."""
        with torch.no_grad():
            for live, average in zip(self._live, self._average):
                kept = live.clone()
                live.copy_(average)
                average.copy_(kept)

    def state(self) -> Iterator[tuple[str, Tensor]]:
        """Names and tensors of the average and of Adam's moments."""
        for i, average in enumerate(self._average):
            yield f"average.{i}", average
        for i, parameter in enumerate(self.parameters):
            for key, value in self._adam.state[parameter].items():
                yield f"adam.{i}.{key}", value

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Restore the tensors that :meth:`state` gave."""
        with torch.no_grad():
            for i, average in enumerate(self._average):
                average.copy_(tensors[f"average.{i}"])
        for i, parameter in enumerate(self.parameters):
            like = torch.empty_like(parameter.detach())
            self._adam.state[parameter] = {
                "step": tensors[f"adam.{i}.step"].clone(),
                "exp_avg": like.clone().copy_(tensors[f"adam.{i}.exp_avg"]),
                "exp_avg_sq": like.clone().copy_(tensors[f"adam.{i}.exp_avg_sq"]),
            }
