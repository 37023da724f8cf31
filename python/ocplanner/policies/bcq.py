"""Batch-constrained Q-learning: the losses of sampler and critics, an optimiser for each, and target critics."""

import copy
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor

from ocplanner.policies.algorithms import Algorithm
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.policies.bcq_network import BCQ, target_values
from ocplanner.policies.config import (
    NetworkConfig,
    ObservationKind,
    PolicyTraining,
    Preset,
    cpu_preset,
    robomimic_preset,
)
from ocplanner.policies.data import Samples
from ocplanner.policies.learner import EVALUATION_BATCH, crops
from ocplanner.policies.transitions import TransitionBatch
from ocplanner.training.optimisation import Optimisation


class BatchConstrainedQ:
    """BCQ in training; see :class:`ocplanner.policies.learner.Learner`.

    A step is robomimic's: first the sampler learns, then its proposals for the next states, valued by the target
    critics, make the critics' targets, then the target critics follow. One thing differs: the targets follow the
    statistics of batch normalisation too, which robomimic's keep from before the training; only networks with pictures
    have any.
    """

    def __init__(self, fabric: Fabric, config: PolicyTraining, network: BCQ) -> None:
        self.fabric, self.config, self.network = fabric, config, network
        self._bcq = network.config
        self._targets = copy.deepcopy(network.critics).requires_grad_(False).eval()
        self._critics = fabric.setup_module(network.critics)
        critic_rate = partial(config.rate, base=self._bcq.critic_learning_rate)
        self._parts = {"critics": Optimisation(network.critics, config, critic_rate, config.clip)}
        if self._bcq.sampler != "policy":
            self._sampler = fabric.setup_module(network.sampler)
            self._parts["sampler"] = Optimisation(network.sampler, config, config.rate, config.clip)

    def step(self, samples: Samples, rows: np.ndarray, step: int) -> dict[str, Tensor]:
        """One update of everything."""
        fabric, share = self.fabric, slice(self.fabric.global_rank, None, self.fabric.world_size)
        rng = crops(self.config, step, fabric.global_rank)
        batch = samples.transition_batch(rows[share], self.config, fabric.device, rng)
        # Drawn for the whole batch, so that the number of processes does not change it.
        noise = self._noise(len(rows), (2, step))[share]
        self.network.train()
        imitated: dict[str, Tensor] = {}
        if "sampler" in self._parts:
            imitated = self._sampler(batch.observation, batch.actions, noise[:, 0])
            self._parts["sampler"].step(imitated["loss"], step, fabric.backward)
        self.network.sampler.eval()
        targets = self._target(batch, noise[:, 1:])
        losses, values = self._critics(batch.observation, batch.actions, targets)
        self._parts["critics"].step(losses.sum(), step, fabric.backward)
        self._follow()
        return _seen(imitated, losses, values)

    def held_out(self, samples: Samples) -> dict[str, float]:
        """The same numbers, with noise that every call repeats."""
        self.network.eval()
        learns = "sampler" in self._parts
        totals: dict[str, float] = {}
        with torch.inference_mode():
            for start in range(0, len(samples), EVALUATION_BATCH):
                rows = np.arange(start, min(start + EVALUATION_BATCH, len(samples)))
                batch = samples.transition_batch(rows, self.config, self.fabric.device, None)
                noise = self._noise(len(rows), (3, start))
                imitated = self.network.sampler(batch.observation, batch.actions, noise[:, 0]) if learns else {}
                targets = self._target(batch, noise[:, 1:])
                losses, values = self.network.critics(batch.observation, batch.actions, targets)
                for name, value in _seen(imitated, losses, values).items():
                    totals[name] = totals.get(name, 0.0) + float(value) * len(rows)
        return {name: total / len(samples) for name, total in totals.items()}

    def swap(self) -> None:
        """Exchange weights and averages."""
        for part in self._parts.values():
            part.swap()

    def state(self) -> Iterator[tuple[str, Tensor]]:
        """Target critics, and the optimisers'."""
        for name, value in self._targets.state_dict().items():
            yield f"targets.{name}", value
        for part, update in self._parts.items():
            for name, value in update.state():
                yield f"{part}.{name}", value

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over what :meth:`state` gave."""
        for name, value in self._targets.state_dict().items():
            value.copy_(tensors[f"targets.{name}"])
        for part, update in self._parts.items():
            prefix = f"{part}."
            update.restore({name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)})

    @torch.no_grad()
    def _target(self, batch: TransitionBatch, noise: Tensor) -> Tensor:
        proposals = self.network.sampler.propose(batch.next_observation, noise)
        values = self._targets.values(batch.next_observation, proposals)
        return target_values(batch.rewards, batch.dones, values, self._bcq)

    @torch.no_grad()
    def _follow(self) -> None:
        source = self.network.critics.state_dict()
        for name, target in self._targets.state_dict().items():
            if target.is_floating_point():
                target.lerp_(source[name], self._bcq.tau)
            else:
                target.copy_(source[name])

    def _noise(self, count: int, seed: tuple[int, ...]) -> Tensor:
        """(count, 1 + n, L): one for the sampler's loss, n for proposals."""
        rng = np.random.default_rng([self.config.seed, *seed])
        shape = (count, 1 + self._bcq.proposals, self.network.sampler.noise)
        return torch.from_numpy(rng.standard_normal(shape, dtype=np.float32)).to(self.fabric.device)


def encoded(samples: Samples, config: PolicyTraining, network: BCQ, device: torch.device) -> Samples:
    """The samples with the features that a trained policy sees, from central crops, in place of what was recorded."""
    after = samples.following
    here, following = [], []
    with torch.no_grad():
        for start in range(0, len(samples), EVALUATION_BATCH):
            rows = np.arange(start, min(start + EVALUATION_BATCH, len(samples)))
            batch = samples.transition_batch(rows, config, device, None)
            here.append(network.encode(batch.observation).low_dim.cpu())
            following.append(network.encode(batch.next_observation).low_dim.cpu())
    after = replace(after, next_low_dim=torch.cat(following), last_images={})
    return replace(samples, low_dim=torch.cat(here), images={}, transitions=after)


def _seen(imitated: dict[str, Tensor], losses: Tensor, values: Tensor) -> dict[str, Tensor]:
    """What is reported; ``loss`` is the sum that robomimic reports."""
    return {
        "loss": (imitated.get("loss", 0.0) + losses.sum()).detach(),
        **{name: value.detach() for name, value in imitated.items() if name != "loss"},
        "critic_loss": losses.mean().detach(),
        "mean_q": values.mean().detach(),
    }


def _preset(name: Preset, kind: ObservationKind) -> PolicyTraining:
    state = kind == "state"
    if name == "robomimic":
        bcq = BCQConfig() if state else BCQConfig(critic_learning_rate=1e-3, vae_hidden=(1024, 1024))
        return robomimic_preset("bcq", kind, algorithm_settings=bcq)
    steps, batch = (30_000, 100) if state else (15_000, 32)
    # Fewer steps: faster targets, so that values still travel from the end of an episode to its start.
    bcq = BCQConfig(critic_learning_rate=5e-4, tau=5e-3)
    return cpu_preset("bcq", kind, steps, batch, network=NetworkConfig(), algorithm_settings=bcq)


ALGORITHM = Algorithm(BCQ, BatchConstrainedQ, _preset, settings=BCQConfig, rewards=True, hints=False, bfloat16=False)
