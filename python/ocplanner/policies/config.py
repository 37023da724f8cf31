"""What a policy is and how it is trained: frozen, validated settings with presets.

A run folder's ``config.yaml`` is one :class:`PolicyTraining`; the same travels in the policy file.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.algorithms import AlgorithmSettings, find_algorithm
from ocplanner.settings import build, require, require_choice
from ocplanner.training.schedule import Schedule, learning_rate

ObservationKind = Literal["state", "image"]
Preset = Literal["cpu", "robomimic"]
StdActivation = Literal["softplus", "exp"]
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

    algorithm: str = "bc"
    """One of :data:`ocplanner.policies.algorithms.ALGORITHMS`."""
    preset: Preset = "cpu"
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """BC and BC-RNN, and BCQ where a mixture proposes actions."""
    algorithm_settings: AlgorithmSettings = field(default_factory=AlgorithmSettings)
    """What only this algorithm has, such as :class:`ocplanner.policies.bcq_config.BCQConfig`."""
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

    def rate(self, step: int, base: float | None = None) -> float:
        """The learning rate of a step, counted from 0; ``base`` replaces ``learning_rate``."""
        base = self.learning_rate if base is None else base
        return learning_rate(step, base=base, steps=self.steps, warmup=self.warmup, schedule=self.schedule)

    @property
    def reads_hints(self) -> bool:
        """Whether a rollout must make hints: they shift the actions, or are an observation, or both."""
        return self.network.hint is not None or HINT_KEY in self.observation.low_dim

    @property
    def sequence(self) -> int | None:
        """Steps of a training sequence, or None where single steps are learned from."""
        return self.network.sequence if find_algorithm(self.algorithm).sequences else None

    def __post_init__(self) -> None:
        """Check the numbers."""
        algorithm = find_algorithm(self.algorithm)
        require_choice("preset", self.preset, Preset)
        require_choice("schedule", self.schedule, Schedule)
        require_choice("precision", self.precision, Precision)
        own, wanted = type(self.algorithm_settings), algorithm.settings
        require(own is wanted, f"{self.algorithm} needs algorithm_settings of {wanted.__name__}, not {own.__name__}")
        exact = algorithm.bfloat16 or self.precision == "float32"
        require(exact, f"{self.algorithm} learns in float32 alone: drop --precision {self.precision}")
        hint, seen = self.network.hint, self.observation
        require(algorithm.hints or hint is None, f"{self.algorithm} reads no hint: drop --hint, or choose bc or bc-rnn")
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


def preset(name: str, algorithm: str = "bc", kind: str = "state") -> PolicyTraining:
    """The settings called ``robomimic`` (as published) or ``cpu`` (smaller, under an hour on one or two cores).

    Args:
        name: of the preset.
        algorithm: one of :data:`ocplanner.policies.algorithms.ALGORITHMS`.
        kind: ``state`` (low-dimensional observations with the object's pose) or ``image`` (proprioception and cameras).

    Raises:
        UnknownNameError: for any other name.
    """
    require_choice("preset", name, Preset)
    require_choice("observation", kind, ObservationKind)
    return find_algorithm(algorithm).preset(name, kind)  # type: ignore[arg-type]


def robomimic_preset(algorithm: str, kind: ObservationKind, **changes: Any) -> PolicyTraining:
    """What robomimic's published hyperparameters have in common, with an algorithm's own changes."""
    if kind == "state":
        settings: dict[str, Any] = {"steps": 200_000, "batch": 100}
    else:
        resnet = EncoderConfig(type="resnet18", pool="spatial_softmax", keypoints=32, feature=64, feature_relu=True)
        settings = {
            "observation": ObservationConfig(PROPRIOCEPTION, CAMERAS, encoder=resnet),
            "network": NetworkConfig(lstm_hidden=1000),
            "steps": 300_000,
            "batch": 16,
            "save_every": 10_000,
        }
    return PolicyTraining(algorithm, "robomimic", **(settings | changes))


def cpu_preset(algorithm: str, kind: ObservationKind, steps: int, batch: int, **changes: Any) -> PolicyTraining:
    """What the smaller settings have in common, with an algorithm's own steps, batch and changes."""
    seen = ObservationConfig() if kind == "state" else ObservationConfig(PROPRIOCEPTION, CAMERAS)
    settings: dict[str, Any] = {
        "observation": replace(seen, normalise=True),
        "network": NetworkConfig(hidden=(512, 512), lstm_hidden=200),
        "steps": steps,
        "batch": batch,
        "learning_rate": 5e-4,
        "schedule": "cosine",
        "warmup": 200,
        "clip": 10.0,
        "ema": 0.999,
        "save_every": steps // 10,
    }
    return PolicyTraining(algorithm, "cpu", **(settings | changes))


def training_from_dict(values: Mapping[str, Any]) -> PolicyTraining:
    """The inverse of :func:`ocplanner.settings.to_dict` for :class:`PolicyTraining`.

    Files of format 1 keep the algorithm's own settings under ``bcq``, null for other algorithms.

    Raises:
        InvalidValueError: a key is unknown or a value is outside its domain.
        UnknownNameError: there is no such algorithm.
    """
    values = dict(values)
    before = values.pop("bcq", None)
    own = values.pop("algorithm_settings", before) or {}
    settings = find_algorithm(values.get("algorithm", "bc")).settings
    return build(PolicyTraining, values | {"algorithm_settings": build(settings, own)})
