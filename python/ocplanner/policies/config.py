"""What a policy is and how it is trained: frozen, validated settings with presets.

A run folder's ``config.yaml`` is one :class:`PolicyTraining`; the same travels in the policy file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.bcq_config import BCQConfig
from ocplanner.settings import build, require, require_choice

Algorithm = Literal["bc", "bc-rnn", "bcq"]
ObservationKind = Literal["state", "image"]
Preset = Literal["cpu", "robomimic"]
StdActivation = Literal["softplus", "exp"]
Schedule = Literal["constant", "cosine"]
Precision = Literal["float32", "bfloat16"]

HINT_KEY = "ocp_hint"
"""``obs/ocp_hint``: for each k six numbers in the action's frame and scale (position 3, rotation 3), then the flag."""
PROPRIOCEPTION = ("robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos")
POLICY_FILE = "policy.safetensors"
"""What a finished run folder holds."""
CAMERAS = ("agentview", "robot0_eye_in_hand")


@dataclass(frozen=True)
class GmmConfig:
    """Gaussian mixture over actions."""

    modes: int = 5
    min_std: float = 1e-4
    """Added to the activated standard deviation."""
    std_activation: StdActivation = "softplus"
    tanh_means: bool = True
    """Squash the means (with a hint: the residuals) into (-1, 1)."""
    low_noise: bool = True
    """Act with a standard deviation of 1e-4 instead of the learned one."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("standard deviation activation", self.std_activation, StdActivation)
        require(self.modes >= 1, f"modes {self.modes} must be at least 1")
        require(self.min_std > 0, f"min_std {self.min_std} must be positive")


@dataclass(frozen=True)
class HintConfig:
    """The plan as a hint: a_t = sum over k of (x, y)_k * hint_k + A."""

    horizons: tuple[int, ...] = (1,)
    """Steps k ahead whose planned displacement ``obs/ocp_hint`` holds, in its order."""
    initial_weight: float = 1.0
    """What x and y are before training; the network predicts what is added to it."""
    residual_penalty: float = 0.0
    """In the loss: so many times the squared motion of the residual A while the object is held, in action units."""
    steers: bool = False
    """While the object is held the hint alone moves it: x = y = ``initial_weight``, and A moves the gripper."""
    instead_of_pictures: bool = False
    """While the object is held the features of the cameras are zero: the plan says what the pictures have to say."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        contradiction = self.steers and self.residual_penalty > 0
        require(not contradiction, "a hint that steers leaves no residual to penalise: drop one of the two")
        require(len(self.horizons) > 0 and min(self.horizons) >= 1, f"hint horizons {self.horizons}: at least 1 step")
        require(len(set(self.horizons)) == len(self.horizons), f"hint horizons {self.horizons}: name each once")
        require(self.residual_penalty >= 0, f"residual penalty {self.residual_penalty} must not be negative")

    @property
    def width(self) -> int:
        """Numbers a step in ``obs/ocp_hint``: six for each k, and the flag."""
        return 6 * len(self.horizons) + 1


@dataclass(frozen=True)
class ObservationConfig:
    """What a policy sees."""

    low_dim: tuple[str, ...] = ("object", *PROPRIOCEPTION)
    """Names under ``obs``, concatenated in this order."""
    cameras: tuple[str, ...] = ()
    image_size: int = 84
    crop: int = 76
    """Side of the crop: random in training, central in rollouts."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """One network of this kind for each camera."""
    normalise: bool = False
    """Standardise the low-dimensional numbers by the training data's mean and standard deviation."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        named = (*self.low_dim, *self.cameras)
        require(len(named) > 0, "name at least one observation")
        require(len(set(named)) == len(named), f"observations {named}: name each once")
        require(0 < self.crop <= self.image_size, f"crop {self.crop} must lie in 1..{self.image_size} pixels")


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes between the observations and the mixture."""

    hidden: tuple[int, ...] = (1024, 1024)
    """BC: widths of the layers."""
    lstm_hidden: int = 400
    lstm_layers: int = 2
    sequence: int = 10
    """BC-RNN: steps in a training sequence, and after how many a rollout begins with a fresh state."""
    gmm: GmmConfig = field(default_factory=GmmConfig)
    hint: HintConfig | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        widths = (*self.hidden, self.lstm_hidden, self.lstm_layers, self.sequence)
        require(min(widths) >= 1, "layer widths, LSTM layers and sequence must be at least 1")


@dataclass(frozen=True)
class PolicyTraining:
    """Everything that decides the weights of a policy, given a data set."""

    algorithm: Algorithm = "bc"
    preset: Preset = "cpu"
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """BC and BC-RNN, and BCQ where a mixture proposes."""
    bcq: BCQConfig | None = None
    """BCQ: its networks and targets; None for the others."""
    steps: int = 200_000
    batch: int = 100
    """Samples (BC, BCQ) or sequences (BC-RNN) a step, over all processes together."""
    learning_rate: float = 1e-4
    """Before any schedule; of BCQ its sampler's."""
    weight_decay: float = 0.0
    schedule: Schedule = "constant"
    warmup: int = 0
    """Steps of linear warm-up."""
    clip: float | None = None
    """Largest norm of the gradient; None: not clipped."""
    ema: float = 0.0
    """Decay of the moving average of the weights, which is then what is saved as the policy; 0: off."""
    mask: str | None = "train"
    """Train on ``mask/<name>``; None: on every demonstration."""
    seed: int = 0
    save_every: int = 5000
    """Steps between two policies kept in ``policies/``."""
    validate_every: int = 1000
    checkpoint_every: int = 1000
    threads: int = 1
    device: str = "cpu"
    precision: Precision = "float32"
    """Of the products inside layers while training; weights, mixture, loss and rollouts are float32 either way."""

    @property
    def reads_hints(self) -> bool:
        """Whether a rollout must make hints: they shift the actions, or are an observation, or both."""
        return self.network.hint is not None or HINT_KEY in self.observation.low_dim

    def __post_init__(self) -> None:
        """Check the numbers."""
        require_choice("algorithm", self.algorithm, Algorithm)
        require_choice("preset", self.preset, Preset)
        require_choice("schedule", self.schedule, Schedule)
        require_choice("precision", self.precision, Precision)
        require((self.algorithm == "bcq") == (self.bcq is not None), "bcq settings belong to the algorithm bcq alone")
        rounded = self.bcq is not None and self.precision == "bfloat16"
        require(not rounded, "bcq learns in float32 alone: drop --precision bfloat16, or choose bc or bc-rnn")
        hint, seen = self.network.hint, self.observation
        require(self.bcq is None or hint is None, "bcq reads no hint; choose bc or bc-rnn, or no hint")
        if hint is not None and hint.instead_of_pictures:
            require(len(seen.cameras) > 0, "a hint instead of pictures needs pictures: --observations image")
            listed = " ".join((*seen.low_dim, HINT_KEY))
            require(HINT_KEY in seen.low_dim, f"a hint instead of pictures must be observed: --low-dim {listed}")
        intervals = (self.save_every, self.validate_every, self.checkpoint_every)
        require(min(self.steps, self.batch, self.threads, *intervals) >= 1, "steps, batch, intervals: at least 1")
        require(self.learning_rate > 0, f"learning rate {self.learning_rate} must be positive")
        require(self.weight_decay >= 0 and self.warmup >= 0, "weight decay and warm-up must not be negative")
        require(self.clip is None or self.clip > 0, f"clip {self.clip} must be positive, or None")
        require(0 <= self.ema < 1, f"ema {self.ema} must lie in [0, 1)")
        require(self.seed >= 0, f"seed {self.seed} must not be negative")


def preset(name: str, algorithm: Algorithm = "bc", kind: ObservationKind = "state") -> PolicyTraining:
    """The settings called ``robomimic`` (as published) or ``cpu`` (smaller, under an hour on one or two cores).

    Args:
        name: of the preset.
        algorithm: ``bc``, ``bc-rnn`` or ``bcq``.
        kind: ``state`` (low-dimensional observations with the object's pose) or ``image`` (proprioception and cameras).

    Raises:
        UnknownNameError: for any other name.
    """
    require_choice("preset", name, Preset)
    require_choice("algorithm", algorithm, Algorithm)
    require_choice("observation", kind, ObservationKind)
    return _robomimic(algorithm, kind) if name == "robomimic" else _cpu(algorithm, kind)


def _robomimic(algorithm: Algorithm, kind: ObservationKind) -> PolicyTraining:
    bcq = algorithm == "bcq"
    if kind == "state":
        return PolicyTraining(algorithm, "robomimic", bcq=BCQConfig() if bcq else None, steps=200_000, batch=100)
    resnet = EncoderConfig(type="resnet18", pool="spatial_softmax", keypoints=32, feature=64, feature_relu=True)
    return PolicyTraining(
        algorithm,
        "robomimic",
        ObservationConfig(PROPRIOCEPTION, CAMERAS, encoder=resnet),
        NetworkConfig(lstm_hidden=1000),
        BCQConfig(critic_learning_rate=1e-3, vae_hidden=(1024, 1024)) if bcq else None,
        steps=300_000,
        batch=16,
        save_every=10_000,
    )


_CPU_IMAGE = {"bc": (20_000, 64), "bc-rnn": (12_000, 16), "bcq": (15_000, 32)}
"""Steps and batch of the ``cpu`` preset that learns from images."""


def _cpu(algorithm: Algorithm, kind: ObservationKind) -> PolicyTraining:
    state = kind == "state"
    steps, image_batch = _CPU_IMAGE[algorithm]
    if state:
        steps = 30_000 if algorithm == "bcq" else 20_000
    return PolicyTraining(
        algorithm,
        "cpu",
        ObservationConfig(normalise=True) if state else ObservationConfig(PROPRIOCEPTION, CAMERAS, normalise=True),
        NetworkConfig() if algorithm == "bcq" else NetworkConfig(hidden=(512, 512), lstm_hidden=200),
        # Fewer steps: faster targets, so that values still travel from the end of an episode to its start.
        BCQConfig(critic_learning_rate=5e-4, tau=5e-3) if algorithm == "bcq" else None,
        steps=steps,
        batch=100 if state else image_batch,
        learning_rate=1e-3 if algorithm == "bc-rnn" else 5e-4,
        schedule="cosine",
        warmup=200,
        clip=10.0,
        ema=0.999,
        save_every=steps // 10,
    )


def training_from_dict(values: Mapping[str, Any]) -> PolicyTraining:
    """The inverse of :func:`ocplanner.planner.config.to_dict` for :class:`PolicyTraining`.

    Raises:
        InvalidValueError: a key is unknown or a value is outside its domain.
    """
    values = dict(values)
    observation, network = dict(values.pop("observation", {})), dict(values.pop("network", {}))
    hint, bcq = network.pop("hint", None), values.pop("bcq", None)
    parts = {
        "bcq": None if bcq is None else build(BCQConfig, bcq),
        "observation": build(
            ObservationConfig, observation | {"encoder": build(EncoderConfig, observation.pop("encoder", {}))}
        ),
        "network": build(
            NetworkConfig,
            network
            | {
                "gmm": build(GmmConfig, network.pop("gmm", {})),
                "hint": None if hint is None else build(HintConfig, hint),
            },
        ),
    }
    return build(PolicyTraining, values | parts)
