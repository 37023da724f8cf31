"""The three stages of training: what each one trains, its loss on a batch and its errors on held-out demonstrations.

All random numbers of a step come from a generator seeded by (seed, stage, step), so that a resumed run repeats exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from ocplanner.planner.augment import augmented, observed, to_input
from ocplanner.planner.config import PlannerTraining
from ocplanner.planner.frames import Frames
from ocplanner.planner.metrics import PlanErrors, plan_errors
from ocplanner.planner.network import Normaliser, PlannerNetwork
from ocplanner.planner.predictor import latent_distance, winner_takes_all
from ocplanner.planner.vae import Latent, kl_to_prior, trajectory_loss

_CHUNK = 256


@dataclass
class Material:
    """What all stages share: the network, the data, and the conversions between them."""

    config: PlannerTraining
    network: PlannerNetwork
    normaliser: Normaliser
    train: Frames
    valid: Frames
    mask_rgb: tuple[int, int, int] | None

    def __post_init__(self) -> None:
        """Normalise both sets' trajectories once."""
        self.train_targets = self._targets(self.train)
        self.valid_targets = self._targets(self.valid)

    def _targets(self, frames: Frames) -> Tensor:
        rotations = frames.rotations if self.config.network.outputs == "pose" else None
        return torch.from_numpy(self.normaliser.encode(frames.positions, rotations)).to(self.config.device)

    def batch_images(self, rows: np.ndarray, rng: np.random.Generator) -> dict[str, Tensor]:
        """Augmented training images of some frames."""
        crop, change = self.config.network.crop, self.config.augmentation
        return {
            name: augmented(camera, rows, crop, self.mask_rgb, change, rng).to(self.config.device)
            for name, camera in self.train.cameras.items()
        }

    def clean_images(self, frames: Frames, rows: np.ndarray) -> dict[str, Tensor]:
        """Images of some frames as the planner will see them."""
        crop = self.config.network.crop
        return {
            name: to_input(observed(camera, rows, self.mask_rgb), crop).to(self.config.device)
            for name, camera in frames.cameras.items()
        }

    def plan(self, frames: Frames) -> np.ndarray:
        """(N, H, 3 or 9) normalised plans for all frames, from clean images."""
        self.network.eval()
        with torch.inference_mode():
            plans = [self.network(self.clean_images(frames, rows)).cpu().numpy() for rows in chunks(len(frames))]
        return np.concatenate(plans)

    def errors(self, numbers: np.ndarray, frames: Frames) -> PlanErrors:
        """Errors of normalised plans (N, H, 3 or 9) for the frames."""
        positions, rotations = self.normaliser.decode(numbers)
        return plan_errors(positions, frames.positions, rotations, frames.rotations, frames.remaining)

    def validate_plans(self, loss: Callable[[dict[str, Tensor], np.ndarray], Tensor]) -> dict[str, float]:
        """``valid_loss``, the mean of ``loss`` over clean held-out images (with their rows), and plan errors."""
        total = 0.0
        with torch.inference_mode():
            for rows in chunks(len(self.valid)):
                total += float(loss(self.clean_images(self.valid, rows), rows)) * len(rows)
        errors = self.errors(self.plan(self.valid), self.valid)
        return {"valid_loss": total / len(self.valid), **errors.as_row()}


class VaeStage:
    """Trajectory encoder and decoder on reconstruction and KL divergence."""

    name: ClassVar[str] = "vae"

    def __init__(self, material: Material) -> None:
        self.material, self.config = material, material.config.vae
        self.module = nn.ModuleList([material.network.trajectory_encoder, material.network.decoder])

    def loss(self, rows: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Negative evidence lower bound with the configured weights, one sample of the latent."""
        true = self.material.train_targets[rows]
        noise = rng.standard_normal((len(rows), self.material.config.network.latent), dtype=np.float32)
        return self._loss(true, torch.from_numpy(noise).to(true.device)).mean()

    def _loss(self, true: Tensor, noise: Tensor | None) -> Tensor:
        network, weights = self.material.network, self.material.config.loss
        posterior = network.trajectory_encoder(true)
        z = posterior.mu if noise is None else posterior.mu + noise * posterior.log_sigma.exp()
        return trajectory_loss(network.decoder(z), true, weights) + weights.kl * kl_to_prior(posterior)

    def validate(self) -> dict[str, float]:
        """The loss with the posterior's mean as latent, and errors of the reconstructions."""
        network, targets = self.material.network, self.material.valid_targets
        self.module.eval()
        losses, plans = [], []
        with torch.inference_mode():
            for rows in chunks(len(targets)):
                losses.append(self._loss(targets[rows], None))
                plans.append(network.decoder(network.trajectory_encoder(targets[rows]).mu).cpu().numpy())
        errors = self.material.errors(np.concatenate(plans), self.material.valid)
        return {"valid_loss": float(torch.cat(losses).mean()), **errors.as_row()}


class PredictorStage:
    """Image encoders and predictor on the distance to the trajectory encoder's posterior."""

    name: ClassVar[str] = "predictor"

    def __init__(self, material: Material) -> None:
        self.material, self.config = material, material.config.predictor
        self.module = material.network.predictor
        self.train_posterior = self._posterior(material.train_targets)
        self.valid_posterior = self._posterior(material.valid_targets)

    def _posterior(self, targets: Tensor) -> Latent:
        encoder = self.material.network.trajectory_encoder.eval()
        with torch.no_grad():
            parts = [encoder(targets[rows]) for rows in chunks(len(targets))]
        return Latent(torch.cat([part.mu for part in parts]), torch.cat([part.log_sigma for part in parts]))

    def loss(self, rows: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Distance of the predicted latent distribution of augmented images."""
        return self._loss(self.material.batch_images(rows, rng), self.train_posterior, rows)

    def _loss(self, images: dict[str, Tensor], posterior: Latent, rows: np.ndarray) -> Tensor:
        weights = self.material.config.loss
        prediction = self.module(images)
        true = Latent(posterior.mu[rows, None], posterior.log_sigma[rows, None])
        return winner_takes_all(latent_distance(prediction.latent, true, weights), prediction.logits, weights)

    def validate(self) -> dict[str, float]:
        """The same loss on clean images, and errors of the plans."""
        self.module.eval()
        return self.material.validate_plans(lambda images, rows: self._loss(images, self.valid_posterior, rows))


class FinetuneStage:
    """Predictor and decoder together on the error of the planned trajectory."""

    name: ClassVar[str] = "finetune"

    def __init__(self, material: Material) -> None:
        self.material, self.config = material, material.config.finetune
        self.module = nn.ModuleList([material.network.predictor, material.network.decoder])

    def loss(self, rows: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Trajectory loss of the plans made from augmented images."""
        return self._loss(self.material.batch_images(rows, rng), self.material.train_targets[rows])

    def _loss(self, images: dict[str, Tensor], true: Tensor) -> Tensor:
        network, weights = self.material.network, self.material.config.loss
        prediction = network.predictor(images)
        mu = prediction.latent.mu
        plans = network.decoder(mu.flatten(0, 1)).unflatten(0, mu.shape[:2])
        return winner_takes_all(trajectory_loss(plans, true[:, None], weights), prediction.logits, weights)

    def validate(self) -> dict[str, float]:
        """The same loss on clean images, and errors of the plans."""
        self.module.eval()
        targets = self.material.valid_targets
        return self.material.validate_plans(lambda images, rows: self._loss(images, targets[rows]))


Stage = VaeStage | PredictorStage | FinetuneStage
"""A stage; its ``name`` is its key in ``metrics.jsonl`` and TensorBoard, its ``module`` the part that is trained."""

STAGES: tuple[type[Stage], ...] = (VaeStage, PredictorStage, FinetuneStage)


def chunks(count: int) -> list[np.ndarray]:
    """Row numbers 0 ... count - 1 in chunks small enough for memory."""
    return [np.arange(start, min(start + _CHUNK, count)) for start in range(0, count, _CHUNK)]
