"""What a policy is and how it is trained: frozen, validated settings with presets.

A run folder's ``config.yaml`` is one :class:`PolicyTraining`; the same travels in the policy file's header.
``ocplanner train-policy`` parses this class: every field is a flag, and the text below it its help.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from tyro.conf import Fixed, FlagCreatePairsOff, Suppress, arg

from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.algorithms import ALGORITHMS, AlgorithmSettings, find_algorithm
from ocplanner.settings import build, require, require_choice, require_names, require_seed
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
    """Gaussians in the mixture."""
    min_std: float = 1e-4
    """Added to the activated standard deviation."""
    std_activation: StdActivation = "softplus"
    """What makes standard deviations positive."""
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

    horizons: Suppress[Fixed[tuple[int, ...]]] = ()
    """Steps k ahead whose planned displacement ``obs/ocp_hint`` holds, in its order; empty: as the data set's labels
    say, which training fills in."""
    initial_weight: Annotated[float, arg(name="hint-weight", prefix_name=False)] = 1.0
    """What x and y start from; the network predicts what is added to it."""
    residual_penalty: Annotated[float, arg(name="hint-residual-penalty", prefix_name=False)] = 0.0
    """Weight in the loss of the residual A's squared motion while the object is held, in action units."""
    steers: Annotated[bool, FlagCreatePairsOff, arg(name="hint-steers", prefix_name=False)] = False
    """While the object is held the hint alone moves it, x = y = --hint-weight, and A moves the gripper."""
    instead_of_pictures: Annotated[
        bool, FlagCreatePairsOff, arg(name="hint-instead-of-pictures", prefix_name=False)
    ] = False
    """While the object is held the policy sees the plan in place of the cameras' pictures: their features are zero."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        contradiction = self.steers and self.residual_penalty > 0
        require(not contradiction, "a hint that steers leaves no residual to penalise: drop one of the two")
        require(min(self.horizons, default=1) >= 1, f"hint horizons {self.horizons}: at least 1 step")
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
    """Names of the low-dimensional observations under obs, concatenated in this order."""
    cameras: tuple[str, ...] = ()
    """Cameras whose pictures the policy sees."""
    image_size: int = 84
    """Side of the pictures, pixels."""
    crop: int = 76
    """Side of the crop, pixels: random in training, central in rollouts."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """One network of this kind for each camera."""
    normalise: bool = False
    """Standardise the low-dimensional numbers by the training data's mean and standard deviation."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        named = (*require_names("low_dim", self.low_dim), *require_names("cameras", self.cameras))
        require(len(named) > 0, "name at least one observation")
        require(len(set(named)) == len(named), f"observations {named}: name each once")
        require(0 < self.crop <= self.image_size, f"crop {self.crop} must lie in 1..{self.image_size} pixels")


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes between the observations and the mixture."""

    hidden: tuple[int, ...] = (1024, 1024)
    """BC: widths of the layers."""
    lstm_hidden: int = 400
    """BC-RNN: units of each LSTM layer."""
    lstm_layers: int = 2
    """BC-RNN: LSTM layers."""
    sequence: int = 10
    """BC-RNN: steps in a training sequence, and after how many a rollout begins with a fresh state."""
    gmm: GmmConfig = field(default_factory=GmmConfig)
    """The mixture over actions."""
    hint: HintConfig | None = None
    """How the plan is used as a hint; None: it is not."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        widths = (*self.hidden, self.lstm_hidden, self.lstm_layers, self.sequence)
        require(min(widths) >= 1, "layer widths, LSTM layers and sequence must be at least 1")


@dataclass(frozen=True)
class PolicyTraining:
    """Everything that decides the weights of a policy, given a data set."""

    algorithm: Annotated[str, arg(metavar=f"{{{','.join(ALGORITHMS)}}}")] = "bc"
    """bc: the last observation decides. bc-rnn: an LSTM remembers. bcq: learns from rewards, which `ocplanner label
    --reward` makes dense. Flags of one algorithm alone are shown with it: train-policy --algorithm bcq --help."""
    preset: Preset = "cpu"
    """cpu: small networks, under an hour on one or two cores. robomimic: published hyperparameters."""
    observation: Annotated[ObservationConfig, arg(name="")] = field(default_factory=ObservationConfig)
    network: Annotated[NetworkConfig, arg(name="")] = field(default_factory=NetworkConfig)
    """BC and BC-RNN, and BCQ where a mixture proposes actions."""
    algorithm_settings: Annotated[AlgorithmSettings, arg(name="")] = field(default_factory=AlgorithmSettings)
    """What only this algorithm has, such as :class:`ocplanner.policies.bcq_config.BCQConfig`."""
    steps: int = 200_000
    """Training steps."""
    batch: int = 100
    """Samples or sequences a step, over all processes together."""
    learning_rate: float = 1e-4
    """Before any schedule; for bcq, the learning rate of its sampler."""
    weight_decay: float = 0.0
    """AdamW's; with 0 it is Adam."""
    schedule: Schedule = "constant"
    """The learning rate after the warm-up; cosine: to zero at the last step."""
    warmup: int = 0
    """Steps of linear warm-up."""
    clip: float | None = None
    """Largest norm of the gradient; None: not clipped."""
    ema: float = 0.0
    """Decay of the averaged weights that become the policy; 0: off."""
    mask: str | None = "train"
    """Train on mask/NAME of the data set; None: on every demonstration."""
    seed: int = 0
    """Decides initial weights, batches and crops."""
    save_every: int = 5000
    """Steps between the policies kept for evaluation."""
    validate_every: int = 1000
    """Steps between two lines of metrics, with losses on mask/valid."""
    checkpoint_every: int = 1000
    """Steps between two checkpoints, from which a stopped training goes on."""
    threads: int = 1
    """CPU threads of each process."""
    device: str = "cpu"
    """cpu, cuda or mps."""
    precision: Precision = "float32"
    """bfloat16 rounds the products inside layers while training: faster on processors that have it. Weights, mixture,
    loss and rollouts are float32 either way."""

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
        require(algorithm.hints or hint is None, f"{self.algorithm} reads no hint: drop --hint, or change --algorithm")
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
        require_seed(self.seed)


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
