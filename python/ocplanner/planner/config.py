"""What a planner is and how it is trained: frozen, validated settings with presets.

A run folder's ``config.yaml`` is one :class:`PlannerTraining`; its network travels in the planner file's header.
``ocplanner train-planner`` parses this class: every field is a flag, and the text below it its help.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from tyro.conf import arg

from ocplanner.files.records.planner import EncoderType, Observe, Outputs, Pool
from ocplanner.settings import require, require_choice, require_names, require_seed
from ocplanner.training.schedule import StageConfig

Preset = Literal["cpu", "robomimic"]
LatentLoss = Literal["l2", "kl"]
Kept = Literal["better", "predictor", "finetune"]


@dataclass(frozen=True)
class EncoderConfig:
    """One camera's image encoder."""

    type: Annotated[EncoderType, arg(name="encoder", prefix_name=False)] = "small"
    """Image encoder; another than the preset's comes with the settings below of the preset that has it."""
    channels: Annotated[tuple[int, ...], arg(prefix_name=False)] = (8, 16, 32, 64)
    """Channels of the small encoder's 3x3, stride-2 convolutions; ignored by resnet18."""
    pool: Annotated[Pool, arg(prefix_name=False)] = "flatten"
    """How the encoder's feature map becomes numbers."""
    keypoints: int = 32
    """Keypoints of the spatial softmax."""
    temperature: float = 1.0
    """Temperature of the spatial softmax."""
    feature: int = 64
    """Numbers that the encoder makes of an image."""
    feature_relu: bool = False
    """Rectify them."""
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
    """Steps planned ahead, H (5, 20 or 50 in the paper)."""
    outputs: Outputs = "pose"
    """Plan the object's pose or only its position."""
    image_size: int = 84
    """Side of the square images, pixels; must be how the data set was rendered."""
    crop: int = 76
    """Side of the part of an image that the network sees, pixels."""
    latent: int = 32
    """Length of a latent plan."""
    modes: int = 1
    """Alternative plans per image; the most probable one is followed."""
    trajectory_hidden: int = 128
    """LSTM units of the trajectory encoder."""
    decoder_hidden: int = 128
    """LSTM units of the trajectory decoder."""
    predictor_hidden: tuple[int, ...] = (256, 256)
    """Hidden layers of the latent predictor."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """Image encoder, one a camera."""

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

    position: Annotated[float, arg(name="c-pos", prefix_name=False)] = 1.0
    """Weight of the position error, c_pos."""
    rotation: Annotated[float, arg(name="c-rot", prefix_name=False)] = 1.0
    """Weight of the rotation error, c_rot."""
    kl: Annotated[float, arg(name="kl-weight", prefix_name=False)] = 0.003
    """Weight of the VAE's KL divergence; the paper's 1 leaves most latents unused."""
    latent: Annotated[LatentLoss, arg(name="latent-loss", prefix_name=False)] = "l2"
    """Loss of the latent predictor: L2 on {mu, sigma} or KL divergence."""
    other_modes: float = 0.03
    """Share of the loss that modes other than the closest one receive, so that none dies."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("latent loss", self.latent, LatentLoss)
        numbers = (self.position, self.rotation, self.kl, self.other_modes)
        require(min(numbers) >= 0, "loss weights must not be negative")


@dataclass(frozen=True)
class AugmentationConfig:
    """Random changes of training images; probabilities are per image."""

    crop_shift: int = 4
    """Largest offset of the random crop from the centre, pixels."""
    brightness: float = 0.15
    """Largest change of the brightness; an image's values are 0 to 1."""
    contrast: float = 0.15
    """Largest relative change of the contrast."""
    channel_gain: float = 0.05
    """Largest relative change of each colour channel."""
    swap: float = 0.6
    """Probability that another arm's silhouette replaces the source robot's (masked only)."""
    union: float = 0.2
    """Probability that another arm's silhouette joins the source robot's (masked only)."""
    stray: float = 0.25
    """Probability that a silhouette of another frame, mirrored or shifted, joins (masked only)."""
    blob: float = 0.25
    """Probability that an ellipse of the mask's colour joins (masked only)."""
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
class VaeConfig(StageConfig):
    """Stage 1: the trajectory VAE."""

    steps: Annotated[int, arg(name="vae-steps", prefix_name=False)] = 2500
    """Steps of stage 1, the trajectory VAE. Default: cpu 2500, robomimic 10000."""
    batch: int = 128
    learning_rate: float = 2e-3
    weight_decay: float = 0.0


@dataclass(frozen=True)
class PredictorConfig(StageConfig):
    """Stage 2: the latent predictor."""

    steps: Annotated[int, arg(name="predictor-steps", prefix_name=False)] = 3500
    """Steps of stage 2, the latent predictor. Default: cpu 3500, robomimic 60000."""


@dataclass(frozen=True)
class FinetuneConfig(StageConfig):
    """Stage 3: predictor and decoder together on the trajectory loss."""

    steps: Annotated[int, arg(name="finetune-steps", prefix_name=False)] = 1500
    """Steps of stage 3, predictor and decoder on the trajectory loss; 0: none. Default: cpu 1500, robomimic 10000."""
    learning_rate: float = 3e-4


@dataclass(frozen=True)
class PlannerTraining:
    """Everything that decides the weights of a planner, given a data set."""

    preset: Preset = "cpu"
    """cpu: a small encoder, minutes on one core. robomimic: ResNet18 and spatial softmax, for a GPU."""
    observe: Observe = "masked"
    """What the images show; must be how the data set was rendered."""
    cameras: tuple[str, ...] = ("agentview",)
    """Cameras that the planner reads."""
    object: str | None = None
    """The object to plan for, by default the task's first; of one that several arms carry, an arm's part: payload:0."""
    seed: int = 0
    """Decides initial weights, batches and augmentation."""
    network: Annotated[NetworkConfig, arg(name="")] = field(default_factory=NetworkConfig)
    """Architecture."""
    loss: LossConfig = field(default_factory=LossConfig)
    """Weights of the losses."""
    vae: VaeConfig = field(default_factory=VaeConfig)
    predictor: PredictorConfig = field(default_factory=PredictorConfig)
    finetune: FinetuneConfig = field(default_factory=FinetuneConfig)
    keep: Kept = "better"
    """Which stage's network becomes the planner; better: on held-out demonstrations."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """Random changes of training images."""
    validate_every: int = 500
    """Steps between validations."""
    checkpoint_every: int = 500
    """Steps between checkpoints, from which a stopped training continues."""
    threads: int = 1
    """CPU threads; the weights are reproducible for one count."""
    device: str = "cpu"
    """torch device."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("preset", self.preset, Preset)
        require_choice("observe", self.observe, Observe)
        require_choice("keep", self.keep, Kept)
        require_names("cameras", self.cameras)
        require(
            len(self.cameras) > 0 and len(set(self.cameras)) == len(self.cameras), "name each camera once, at least one"
        )
        require(
            min(self.validate_every, self.checkpoint_every, self.threads) >= 1,
            "intervals and threads must be at least 1",
        )
        require_seed(self.seed)
        require(min(self.vae.steps, self.predictor.steps) >= 1, "the VAE and the predictor need at least 1 step")
        unused = self.keep == "finetune" and self.finetune.steps == 0
        require(not unused, "keep=finetune needs finetune steps")
        margin = (self.network.image_size - self.network.crop) // 2
        require(
            self.augmentation.crop_shift <= margin,
            f"crop_shift {self.augmentation.crop_shift} exceeds the margin of {margin} pixels around the centre crop",
        )


def preset(name: str, encoder: EncoderType | None = None) -> PlannerTraining:
    """The settings called ``cpu`` (small encoder, minutes on one core) or ``robomimic`` (ResNet18, for a GPU).

    Args:
        name: of the preset.
        encoder: another image encoder than the preset's, with the settings that it has in the other preset.

    Raises:
        UnknownNameError: for any other name.
    """
    require_choice("preset", name, Preset)
    resnet18 = EncoderConfig(type="resnet18", pool="spatial_softmax", keypoints=32, feature=64)
    training = PlannerTraining()
    if name == "robomimic":
        training = PlannerTraining(
            preset="robomimic",
            network=NetworkConfig(
                encoder=resnet18, predictor_hidden=(1024, 1024), decoder_hidden=256, trajectory_hidden=256
            ),
            vae=VaeConfig(steps=10_000, learning_rate=1e-3),
            predictor=PredictorConfig(steps=60_000, learning_rate=3e-4),
            finetune=FinetuneConfig(steps=10_000, learning_rate=1e-4),
            validate_every=2000,
            checkpoint_every=2000,
        )
    if encoder in (None, training.network.encoder.type):
        return training
    require_choice("encoder", encoder, EncoderType)
    other = resnet18 if encoder == "resnet18" else EncoderConfig()
    return replace(training, network=replace(training.network, encoder=other))
