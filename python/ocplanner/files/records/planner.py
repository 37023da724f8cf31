"""The header of a planner file: everything that it says about itself beside its weights."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ocplanner.errors import ModelFileError
from ocplanner.settings import build, to_dict

PLANNER_FORMAT = 1

Outputs = Literal["pose", "position"]
Observe = Literal["full", "masked", "no-robot"]
EncoderType = Literal["small", "resnet18"]
Pool = Literal["spatial_softmax", "flatten"]


@dataclass(frozen=True)
class NormaliserHeader:
    """Mean and standard deviation of the object's positions in the training data, world, metres."""

    mean: tuple[float, float, float]
    std: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class EncoderHeader:
    """Architecture of the image encoders; ``None`` where it does not apply.

    Attributes:
        type: of the convolutional trunk.
        channels: of each convolution of the small trunk.
        pool: how the feature map becomes numbers.
        keypoints: of the spatial softmax.
        temperature: of the spatial softmax; 1 where the file does not say.
        feature: numbers an image.
        feature_relu: whether the last layer is rectified.
    """

    type: EncoderType
    channels: tuple[int, ...] | None = None
    pool: Pool
    keypoints: int | None = None
    temperature: float | None = None
    feature: int
    feature_relu: bool = False


@dataclass(frozen=True)
class PredictorHeader:
    """Hidden layers of the latent predictor."""

    hidden: tuple[int, ...]


@dataclass(frozen=True)
class DecoderHeader:
    """LSTM units of the trajectory decoder."""

    hidden: int


@dataclass(frozen=True)
class TrainingHeader:
    """How the planner was trained.

    Attributes:
        settings: the whole configuration, :class:`ocplanner.planner.config.PlannerTraining` as plain values.
        stage: whose network was kept.
        data: digest of the training frames.
        silhouettes: other arms whose outlines were painted into training images.
        held_out: errors on held-out demonstrations by appearance, see :class:`ocplanner.planner.metrics.PlanErrors`.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    stage: str | None = None
    data: str | None = None
    silhouettes: tuple[str, ...] = ()
    held_out: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PlannerHeader:
    """What a planner file says about itself.

    Attributes:
        task: our name of the task, such as ``Square``.
        object: the object that is planned for, or the part of one that several arms carry (``payload:0``).
        horizon: steps of a plan, H.
        outputs: poses or positions only.
        cameras: whose images the planner reads, in the order of the network's inputs.
        image_size: side of the square images, pixels.
        crop: side of the centre crop that the network sees, pixels.
        observe: what the images show.
        visual: the visual preset that the images were drawn with; None if the data set did not say.
        mask_rgb: the colour painted over the robot (``masked`` only).
        normaliser: statistics of positions.
        latent: length of a latent plan.
        modes: alternative plans an image.
        encoder: the image encoders, one a camera.
        predictor: the latent predictor.
        decoder: the trajectory decoder.
        source_robot: the robot of the demonstrations.
        control_freq: steps of a plan a second, Hz; 20 in files that do not say.
        seed: of the training.
        versions: installed packages at training.
        training: how it was trained.
    """

    task: str
    object: str
    horizon: int
    outputs: Outputs
    cameras: tuple[str, ...]
    image_size: int
    crop: int
    observe: Observe
    visual: str | None
    mask_rgb: tuple[int, int, int] | None
    normaliser: NormaliserHeader
    latent: int
    modes: int = 1
    encoder: EncoderHeader
    predictor: PredictorHeader
    decoder: DecoderHeader
    source_robot: str | None = None
    control_freq: float = 20.0
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    training: TrainingHeader = field(default_factory=TrainingHeader)

    @classmethod
    def from_json(cls, text: str) -> "PlannerHeader":
        """Read the header from the ``config`` entry of a planner file's metadata, as JSON text.

        Raises:
            ModelFileError: a field is missing or wrong; the message names it.
        """
        try:
            return build(cls, json.loads(text), ignore_unknown=True)
        except ValueError as error:
            raise ModelFileError(
                f"the planner's header cannot be read: {error}; train the planner again with `ocplanner train-planner`"
            ) from error

    def metadata(self) -> dict[str, str]:
        """The metadata of the planner's safetensors file."""
        config = to_dict(self)
        config["encoder"] = {name: value for name, value in config["encoder"].items() if value is not None}
        return {"ocplanner": json.dumps({"format": PLANNER_FORMAT, "kind": "planner", "config": config})}
