"""The verb ``train-planner``."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ocplanner.planner.config import Observe, Outputs, PlannerTraining, Pool, Preset, preset


@dataclass(frozen=True)
class TrainPlanner:
    """Train an object-centric planner on a rendered data set; run the same command again to continue after a stop."""

    data: Path
    """Robomimic HDF5 with images, made by `ocplanner render`."""
    run_folder: Annotated[Path, tyro.conf.arg(name="run")]
    """Run folder: config.yaml, metrics.jsonl, TensorBoard events, checkpoints and planner.safetensors."""
    preset: Preset = "cpu"
    """cpu: a small encoder, minutes on one core. robomimic: ResNet18 and spatial softmax, for a GPU."""
    horizon: int = 20
    """Steps planned ahead (5, 20 or 50 in the paper)."""
    outputs: Outputs = "pose"
    """Plan the object's pose or only its position."""
    observe: Observe = "masked"
    """What the images show; must be how the data set was rendered."""
    cameras: tuple[str, ...] = ("agentview",)
    """Cameras that the planner reads."""
    object: str | None = None
    """The object to plan for, of a task with several: train one planner for each. Default: the task's first."""
    seed: int = 0
    """Decides initial weights, batches and augmentation."""
    modes: int | None = None
    """Alternative plans per image; the most probable one is followed. Default: 1."""
    encoder: Literal["small", "resnet18"] | None = None
    """Image encoder instead of the preset's."""
    channels: tuple[int, ...] | None = None
    """Channels of the small encoder's convolutions instead of the preset's (8 16 32 64)."""
    pool: Pool | None = None
    """How the encoder's feature map becomes numbers, instead of the preset's way."""
    latent_loss: Literal["l2", "kl"] | None = None
    """Loss of the latent predictor: L2 on {mu, sigma} or KL divergence. Default: l2."""
    c_pos: float | None = None
    """Weight of the position error. Default: 1."""
    c_rot: float | None = None
    """Weight of the rotation error. Default: 1."""
    kl_weight: float | None = None
    """Weight of the VAE's KL divergence; the paper's is 1. Default: 0.003."""
    vae_steps: int | None = None
    """Steps of stage 1, the trajectory VAE. Default: cpu 2500, robomimic 10000."""
    predictor_steps: int | None = None
    """Steps of stage 2, the latent predictor. Default: cpu 3500, robomimic 60000."""
    finetune_steps: int | None = None
    """Steps of stage 3, predictor and decoder on the trajectory loss; 0: none. Default: cpu 1500, robomimic 10000."""
    keep: Literal["better", "predictor", "finetune"] = "better"
    """Which stage's network becomes the planner; better: on held-out demonstrations."""
    threads: int = 1
    """CPU threads; the weights are reproducible for one count."""
    device: str = "cpu"
    """torch device."""

    def configuration(self) -> PlannerTraining:
        """The preset with these flags applied."""
        base = preset(self.preset)
        encoder = base.network.encoder
        if self.encoder is not None and self.encoder != encoder.type:
            encoder = preset("cpu" if self.encoder == "small" else "robomimic").network.encoder
        encoder = replace(encoder, channels=self.channels or encoder.channels, pool=self.pool or encoder.pool)
        modes = base.network.modes if self.modes is None else self.modes
        network = replace(base.network, horizon=self.horizon, outputs=self.outputs, modes=modes, encoder=encoder)
        weights = {"latent": self.latent_loss, "position": self.c_pos, "rotation": self.c_rot, "kl": self.kl_weight}
        steps = {"vae": self.vae_steps, "predictor": self.predictor_steps, "finetune": self.finetune_steps}
        stages = {name: replace(getattr(base, name), steps=count) for name, count in steps.items() if count is not None}
        return replace(
            base,
            observe=self.observe,
            cameras=self.cameras,
            object=self.object,
            seed=self.seed,
            network=network,
            loss=replace(base.loss, **{name: value for name, value in weights.items() if value is not None}),
            keep=self.keep,
            threads=self.threads,
            device=self.device,
            **stages,
        )

    def run(self) -> None:
        """Train, draw the curves into the run folder's report, and print the planner file's path."""
        from ocplanner.planner.train import train_planner
        from ocplanner.report.page import write_report

        planner = train_planner(self.configuration(), self.data, self.run_folder)
        write_report([self.run_folder], self.run_folder / "report.html")
        sys.stdout.write(f"{planner}\n")


COMMAND = TrainPlanner
