"""Learning to imitate: the likelihood of recorded actions, one optimiser."""

from collections.abc import Iterator, Mapping

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor

from ocplanner.policies.actor import Actor
from ocplanner.policies.config import PolicyTraining
from ocplanner.policies.data import Samples
from ocplanner.policies.learner import EVALUATION_BATCH, crops
from ocplanner.training.optimisation import Optimisation


class Imitation:
    """BC and BC-RNN in training; see :class:`ocplanner.policies.learner.Learner`."""

    def __init__(self, fabric: Fabric, config: PolicyTraining, network: Actor) -> None:
        self.fabric, self.config, self.network = fabric, config, network
        self._parallel = fabric.setup_module(network)
        self._optimisation = Optimisation(network, config, config.rate, config.clip)

    def step(self, samples: Samples, rows: np.ndarray, step: int) -> dict[str, Tensor]:
        """One update."""
        fabric = self.fabric
        share = rows[fabric.global_rank :: fabric.world_size]
        batch = samples.batch(share, self.config, fabric.device, crops(self.config, step, fabric.global_rank))
        self.network.train()
        loss = self._parallel(*batch)
        self._optimisation.step(loss, step, fabric.backward)
        return {"loss": loss.detach()}

    def held_out(self, samples: Samples) -> dict[str, float]:
        """Mean negative log-likelihood of held-out actions, with the learned standard deviations."""
        config = self.config
        self.network.eval()
        total = 0.0
        every = np.arange(0, len(samples), config.sequence or 1)
        with torch.inference_mode():
            for start in range(0, len(every), EVALUATION_BATCH):
                rows = every[start : start + EVALUATION_BATCH]
                total += float(self.network(*samples.batch(rows, config, self.fabric.device, None))) * len(rows)
        return {"loss": total / len(every)}

    def swap(self) -> None:
        """Exchange weights and average."""
        self._optimisation.swap()

    def state(self) -> Iterator[tuple[str, Tensor]]:
        """The optimiser's."""
        return self._optimisation.state()

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over what :meth:`state` gave."""
        self._optimisation.restore(tensors)
