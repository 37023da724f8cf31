"""What a planner is and how it is trained: frozen, validated settings with presets.

A run folder's ``config.yaml`` is one :class:`PlannerTraining`; the network's part travels in the planner file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ocplanner.files.records.planner import EncoderType, Observe, Outputs, Pool
from ocplanner.settings import build, require, require_choice
from ocplanner.settings import to_dict as to_dict
from ocplanner.training.schedule import StageConfig

Preset = Literal["cpu", "robomimic"]


@dataclass(frozen=True)
class EncoderConfig:
    """One camera's image encoder."""

    type: EncoderType = "small"
    channels: tuple[int, ...] = (8, 16, 32, 64)
    """Channels of the small encoder's 3x3, stride-2 convolutions; ignored by resnet18."""
    pool: Pool = "flatten"
    keypoints: int = 32
    temperature: float = 1.0
    feature: int = 64
    feature_relu: bool = False
    batch_norm: bool = True
    """Batch normalisation after each convolution while training; folded into the convolutions at export."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("encoder type", self.type, EncoderType)
        require_choice("pool", self.pool, Pool)
        require(
            len(self.channels) > 0 and min(self.channels) > 0,
            f"encoder channels {self.channels}: give positive numbers",
        )
        require(min(self.keypoints, self.feature) > 0, "encoder keypoints and feature must be positive")
        require(self.temperature > 0, f"spatial softmax temperature {self.temperature} must be positive")


@dataclass(frozen=True)
class NetworkConfig:
    """Architecture of the trajectory VAE and of the latent predictor (the paper's Figure 3)."""

    horizon: int = 20
    """Steps planned ahead, H."""
    outputs: Outputs = "pose"
    image_size: int = 84
    crop: int = 76
    latent: int = 32
    modes: int = 1
    """Alternative plans per image; the most probable one is followed."""
    trajectory_hidden: int = 128
    """LSTM width of the trajectory encoder."""
    decoder_hidden: int = 128
    predictor_hidden: tuple[int, ...] = (256, 256)
    encoder: EncoderConfig = field(default_factory=EncoderConfig)

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("outputs", self.outputs, Outputs)
        require(self.horizon >= 1, f"horizon {self.horizon} must be at least 1 step")
        require(
            self.image_size <= 1024, f"image_size {self.image_size}: the engine reads images of 1024 pixels at most"
        )
        require(0 < self.crop <= self.image_size, f"crop {self.crop} must lie in 1..{self.image_size} pixels")
        require(self.modes >= 1, f"modes {self.modes} must be at least 1")
        widths = (self.latent, self.trajectory_hidden, self.decoder_hidden, *self.predictor_hidden)
        require(min(widths) > 0, "latent and hidden sizes must be positive")

    @property
    def step_size(self) -> int:
        """Numbers per planned step: 3 (position) or 9 (position and 6D rotation)."""
        return 9 if self.outputs == "pose" else 3


@dataclass(frozen=True)
class LossConfig:
    """Weights of section 3's losses, positions in units of the training data's standard deviation."""

    position: float = 1.0
    """c_pos."""
    rotation: float = 1.0
    """c_rot."""
    kl: float = 0.003
    """Weight of the VAE's KL divergence; the paper's 1 leaves most latents unused."""
    latent: Literal["l2", "kl"] = "l2"
    """Distance between predicted and true latent distribution: L2 on {mu, sigma} or KL divergence."""
    other_modes: float = 0.03
    """Share of the loss that modes other than the closest one receive, so that none dies."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("latent loss", self.latent, Literal["l2", "kl"])
        numbers = (self.position, self.rotation, self.kl, self.other_modes)
        require(min(numbers) >= 0, "loss weights must not be negative")


@dataclass(frozen=True)
class AugmentationConfig:
    """Random changes of training images; probabilities are per image."""

    crop_shift: int = 4
    """Largest offset of the random crop from the centre, pixels."""
    brightness: float = 0.15
    contrast: float = 0.15
    channel_gain: float = 0.05
    swap: float = 0.6
    """Another arm's silhouette replaces the source robot's (masked only)."""
    union: float = 0.2
    """Another arm's silhouette joins the source robot's (masked only)."""
    stray: float = 0.25
    """A silhouette of another frame, mirrored or shifted, joins (masked only)."""
    blob: float = 0.25
    """An ellipse of the mask's colour joins (masked only)."""
    mask_error: int = 3
    """Masks are grown, shrunk and shifted by up to this many pixels (masked only)."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        chances = (self.swap, self.union, self.stray, self.blob)
        require(min(chances) >= 0 and max(chances) <= 1, "augmentation probabilities must lie in [0, 1]")
        require(self.swap + self.union <= 1, "swap and union exclude each other: together at most 1")
        require(min(self.crop_shift, self.mask_error) >= 0, "crop_shift and mask_error must not be negative")
        colours = (self.brightness, self.contrast, self.channel_gain)
        require(min(colours) >= 0 and max(colours) < 1, "colour changes must lie in [0, 1)")


@dataclass(frozen=True)
class PlannerTraining:
    """Everything that decides the weights of a planner, given a data set."""

    preset: Preset = "cpu"
    observe: Observe = "masked"
    cameras: tuple[str, ...] = ("agentview",)
    object: str | None = None
    """The object whose motion is planned; the task's first if not given. Of one that several arms carry, the part of
    one of them: ``payload:0`` while arm 0 has it."""
    seed: int = 0
    network: NetworkConfig = field(default_factory=NetworkConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    vae: StageConfig = field(
        default_factory=lambda: StageConfig(steps=2500, batch=128, learning_rate=2e-3, weight_decay=0.0)
    )
    predictor: StageConfig = field(default_factory=lambda: StageConfig(steps=3500))
    finetune: StageConfig = field(default_factory=lambda: StageConfig(steps=1500, learning_rate=3e-4))
    """Predictor and decoder together on the trajectory loss; 0 steps: no third stage."""
    keep: Literal["better", "predictor", "finetune"] = "better"
    """Which stage becomes the planner: the better one on held-out demonstrations, or always the named one."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    validate_every: int = 500
    checkpoint_every: int = 500
    threads: int = 1
    device: str = "cpu"

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("preset", self.preset, Preset)
        require_choice("observe", self.observe, Observe)
        require_choice("keep", self.keep, Literal["better", "predictor", "finetune"])
        require(
            len(self.cameras) > 0 and len(set(self.cameras)) == len(self.cameras), "name each camera once, at least one"
        )
        require(
            min(self.validate_every, self.checkpoint_every, self.threads) >= 1,
            "intervals and threads must be at least 1",
        )
        require(self.seed >= 0, f"seed {self.seed} must not be negative")
        require(min(self.vae.steps, self.predictor.steps) >= 1, "the VAE and the predictor need at least 1 step")
        unused = self.keep == "finetune" and self.finetune.steps == 0
        require(not unused, "keep=finetune needs finetune steps")
        margin = (self.network.image_size - self.network.crop) // 2
        require(
            self.augmentation.crop_shift <= margin,
            f"crop_shift {self.augmentation.crop_shift} exceeds the margin of {margin} pixels around the centre crop",
        )


def preset(name: str) -> PlannerTraining:
    """The settings called ``cpu`` (small encoder, minutes on one core) or ``robomimic`` (ResNet18, for a GPU).

    Raises:
        UnknownNameError: for any other name.
    """
    require_choice("preset", name, Preset)
    if name == "cpu":
        return PlannerTraining()
    resnet = EncoderConfig(type="resnet18", pool="spatial_softmax", keypoints=32, feature=64)
    return PlannerTraining(
        preset="robomimic",
        network=NetworkConfig(encoder=resnet, predictor_hidden=(1024, 1024), decoder_hidden=256, trajectory_hidden=256),
        vae=StageConfig(steps=10_000, batch=128, weight_decay=0.0),
        predictor=StageConfig(steps=60_000, batch=64, learning_rate=3e-4),
        finetune=StageConfig(steps=10_000, batch=64, learning_rate=1e-4),
        validate_every=2000,
        checkpoint_every=2000,
    )


def training_from_dict(values: Mapping[str, Any]) -> PlannerTraining:
    """The settings in a run folder's ``config.yaml`` or a planner's header.

    Raises:
        InvalidValueError: a key is unknown or a value is outside its domain.
    """
    return build(PlannerTraining, values)
