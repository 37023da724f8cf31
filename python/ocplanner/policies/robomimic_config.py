"""robomimic's JSON configurations of ``algo_name: "bc"`` as settings of ours.

Every key that robomimic 0.5 writes is either honoured, or ignored by name because it does not change the training
(logging, rollouts, data loading), or refused; a key that is left out has robomimic's default. See docs/robomimic.md.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any

from ocplanner.errors import InvalidValueError
from ocplanner.planner.config import EncoderConfig
from ocplanner.policies.config import (
    HINT_KEY,
    GmmConfig,
    HintConfig,
    NetworkConfig,
    ObservationConfig,
    PolicyTraining,
)
from ocplanner.policies.robomimic_keys import IGNORED_KEYS, Keys
from ocplanner.training.schedule import Schedule

_LOW_DIM = ["robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos", "object"]
_IMAGE = "_image"


@dataclass(frozen=True)
class RobomimicConfig:
    """What a robomimic configuration says.

    Attributes:
        training: the settings.
        data: ``train.data``, or None.
        ignored: dotted keys and groups of keys that are in the file and do not change the training.
    """

    training: PolicyTraining
    data: Path | None
    ignored: tuple[str, ...]


def read_robomimic_config(path: Path) -> RobomimicConfig:
    """Read a JSON configuration as robomimic writes it; our section ``algo.ocp_hint`` may be in it.

    Raises:
        InvalidValueError: it cannot be read, or it has unknown keys or values that cannot be honoured: all are named.
    """
    try:
        values = json.loads(path.read_text())
    except OSError as error:
        raise InvalidValueError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InvalidValueError(f"{path} is no JSON ({error}); give a configuration as robomimic writes it") from error
    return parse_robomimic_config(values, path)


def parse_robomimic_config(values: Any, path: Path) -> RobomimicConfig:
    """What :func:`read_robomimic_config` makes of a file's values.

    Args:
        values: what the JSON holds.
        path: where it stands, for messages.

    Raises:
        InvalidValueError: it has unknown keys or values that cannot be honoured: all are named.
    """
    found = values.get("algo_name") if isinstance(values, dict) else None
    if found != "bc":
        raise InvalidValueError(f'{path}: algo_name is {json.dumps(found)}; only "bc" can be trained')
    keys = Keys(values)
    keys.take("algo_name", "bc")
    mask, data = _data(keys)
    # What is wrong is collected, so that one run names it all; a value that would fail has its default until then.
    parts = {
        "algorithm": "bc-rnn" if keys.take("algo.rnn.enabled", False) else "bc",
        "observation": _observation(keys),
        "network": _network(keys),
        "mask": mask,
        **_optimisation(keys),
    }
    _fixed(keys)
    keys.ignore(IGNORED_KEYS)
    return RobomimicConfig(PolicyTraining(preset="robomimic", **parts), data, keys.finish(path))


def _data(keys: Keys) -> tuple[str | None, Path | None]:
    """Mask and file."""
    mask = keys.take("train.hdf5_filter_key", None, str)
    entries = keys.take("train.data", None, (str, list, NoneType))
    if entries is None:
        return mask, None
    entries = [{"path": entries}] if isinstance(entries, str) else entries
    if len(entries) != 1 or not isinstance(entries[0], dict) or not isinstance(entries[0].get("path"), str):
        keys.refuse("train.data must name one file; give --data, and leave train.data null")
        return mask, None
    entry = entries[0]
    unknown = set(entry) - {"path", "eval", "lang", "key", "weight", "filter_key", "demo_limit"}
    if unknown or entry.get("demo_limit") is not None:
        keys.refuse(f"train.data: {sorted(unknown) or 'demo_limit'} cannot be honoured; name a mask in filter_key")
    return entry.get("filter_key", mask), Path(entry["path"]).expanduser()


def _observation(keys: Keys) -> ObservationConfig:
    low_dim = keys.names("observation.modalities.obs.low_dim", _LOW_DIM)
    hinted = keys.take("algo.ocp_hint.enabled", False)
    pictures = keys.names("observation.modalities.obs.rgb", [])
    for name in [name for name in pictures if not name.endswith(_IMAGE)]:
        keys.refuse(f"observation.modalities.obs.rgb: {name!r} must end in {_IMAGE!r}")
    normalise = keys.take("train.hdf5_normalize_obs", False)
    if normalise and pictures:
        keys.refuse("train.hdf5_normalize_obs would scale the pictures too: set it to false")
    encoder, crop = EncoderConfig(), ObservationConfig().crop
    if pictures:
        encoder, crop = _encoder(keys)
    else:
        keys.ignore({"observation.encoder.rgb": None})
    # With the hint on, it shifts the means and does not enter the encoder.
    seen = tuple(name for name in low_dim if not (hinted and name == HINT_KEY))
    return ObservationConfig(
        low_dim=seen,
        cameras=tuple(name.removesuffix(_IMAGE) for name in pictures),
        crop=crop,
        encoder=encoder,
        normalise=normalise,
    )


def _encoder(keys: Keys) -> tuple[EncoderConfig, int]:
    """One camera's network, and the side of the crop."""
    core, random = "observation.encoder.rgb.core_kwargs", "observation.encoder.rgb.obs_randomizer_kwargs"
    keys.must("observation.encoder.rgb.core_class", "VisualCore")
    keys.must(f"{core}.backbone_class", "ResNet18Conv")
    keys.must(f"{core}.backbone_kwargs.pretrained", False)
    keys.must(f"{core}.backbone_kwargs.input_coord_conv", False)
    keys.must(f"{core}.flatten", True)
    keys.must(f"{core}.pool_class", "SpatialSoftmax")
    keys.must(f"{core}.pool_kwargs.learnable_temperature", False)
    keys.must(f"{core}.pool_kwargs.noise_std", 0.0)
    keys.must(f"{core}.pool_kwargs.output_variance", False)
    encoder = EncoderConfig(
        type="resnet18",
        pool="spatial_softmax",
        keypoints=keys.count(f"{core}.pool_kwargs.num_kp", 32),
        temperature=keys.positive(f"{core}.pool_kwargs.temperature", 1.0),
        feature=keys.count(f"{core}.feature_dimension", 64),
        feature_relu=True,
    )
    size = ObservationConfig().image_size
    if keys.take("observation.encoder.rgb.obs_randomizer_class", None, str) is None:
        keys.ignore({random: None})
        return encoder, size
    keys.must("observation.encoder.rgb.obs_randomizer_class", "CropRandomizer")
    keys.must(f"{random}.num_crops", 1)
    keys.must(f"{random}.pos_enc", False)
    crop = keys.count(f"{random}.crop_height", size)
    keys.must(f"{random}.crop_width", crop, default=size)
    if crop > size:
        keys.refuse(f"{random}.crop_height {crop}: pictures have {size} pixels a side")
        return encoder, size
    return encoder, crop


def _network(keys: Keys) -> NetworkConfig:
    rnn, default = keys.take("algo.rnn.enabled", False), NetworkConfig()
    keys.must("algo.gmm.enabled", True, default=False, remedy="our policies have a mixture: set it to true")
    gmm = GmmConfig(
        modes=keys.count("algo.gmm.num_modes", 5),
        min_std=keys.positive("algo.gmm.min_std", 1e-4),
        std_activation=keys.choice("algo.gmm.std_activation", "softplus", ("softplus", "exp")),
        low_noise=keys.take("algo.gmm.low_noise_eval", True),
    )
    hidden = keys.counts("algo.actor_layer_dims", [1024, 1024])
    if rnn and hidden:
        keys.refuse(f"algo.actor_layer_dims {list(hidden)}: no layers follow the LSTM here; set it to []")
    length = keys.count("train.seq_length", 1)
    horizon = keys.count("algo.rnn.horizon", 10)
    if length != (horizon if rnn else 1):
        wanted = f"algo.rnn.horizon, {horizon}" if rnn else "1"
        keys.refuse(f"train.seq_length {length}: set it to {wanted}")
    if rnn:
        keys.must("algo.rnn.rnn_type", "LSTM")
        keys.must("algo.rnn.open_loop", False)
        keys.must("algo.rnn.kwargs.bidirectional", False)
    return NetworkConfig(
        hidden=default.hidden if rnn else tuple(hidden),
        lstm_hidden=keys.count("algo.rnn.hidden_dim", 400),
        lstm_layers=keys.count("algo.rnn.num_layers", 2),
        sequence=horizon,
        gmm=gmm,
        hint=_hint(keys),
    )


def _hint(keys: Keys) -> HintConfig | None:
    horizons = tuple(keys.counts("algo.ocp_hint.horizons", [1]))
    weight = float(keys.take("algo.ocp_hint.initial_weight", 1.0))
    return HintConfig(horizons, weight) if keys.take("algo.ocp_hint.enabled", False) else None


def _optimisation(keys: Keys) -> dict[str, Any]:
    """The loop's settings."""
    policy = "algo.optim_params.policy"
    kind = keys.choice(f"{policy}.optimizer_type", "adam", ("adam", "adamw"))
    decay = float(keys.take(f"{policy}.regularization.L2", 0.0))
    if decay < 0 or (decay > 0 and kind == "adam"):
        keys.refuse(f"{policy}.regularization.L2 {decay:g}: only adamw can have a decay; set it to 0 for {kind}")
        decay = 0.0
    keys.ignore(
        {policy: ("num_train_batches", "num_epochs")}
    )  # what robomimic adds when it saves a run's configuration
    epoch = keys.count("experiment.epoch_every_n_steps", 100)
    steps = epoch * keys.count("train.num_epochs", 2000)
    saves = keys.take("experiment.save.enabled", True)
    every = keys.take("experiment.save.every_n_epochs", 50, (int, NoneType)) if saves else None
    if every is not None and every < 1:
        keys.refuse(f"experiment.save.every_n_epochs {every}: give at least 1, or null")
        every = None
    return {
        "steps": steps,
        "batch": keys.count("train.batch_size", 100),
        "learning_rate": keys.positive(f"{policy}.learning_rate.initial", 1e-4),
        "weight_decay": decay,
        "schedule": _schedule(keys, f"{policy}.learning_rate"),
        "clip": keys.positive("train.max_grad_norm", None),
        "seed": keys.count("train.seed", 1, least=0),
        "save_every": steps if every is None else epoch * every,
        "device": _device(keys.take("train.cuda", True)),
    }


def _schedule(keys: Keys, rate: str) -> Schedule:
    kind = keys.choice(f"{rate}.scheduler_type", "multistep", ("multistep", "linear", "cosine"))
    if kind == "cosine":
        keys.must(f"{rate}.step_every_batch", True, default=False)
        keys.must(f"{rate}.warmup_steps", 0)
        keys.must(f"{rate}.num_cycles", 0.5)
        keys.ignore({rate: ("decay_factor", "epoch_schedule")})
        return "cosine"
    keys.must(f"{rate}.epoch_schedule", [], remedy='set it to [], or scheduler_type to "cosine"')
    keys.ignore({rate: ("decay_factor", "step_every_batch", "warmup_steps", "num_cycles")})
    return "constant"


def _device(cuda: bool) -> str:
    """As robomimic reads ``train.cuda``: a GPU if there is one."""
    import torch

    return "cuda" if cuda and torch.cuda.is_available() else "cpu"


def _fixed(keys: Keys) -> None:
    """What has one value here."""
    keys.must("experiment.ckpt_path", None)
    keys.must("train.action_keys", ["actions"])
    keys.must("train.action_config.actions.normalization", None)
    keys.must("train.frame_stack", 1)
    keys.must("train.goal_mode", None)
    keys.must("train.pad_seq_length", True)
    keys.must("algo.gaussian.enabled", False)
    keys.must("algo.transformer.enabled", False)
    keys.must("algo.vae.enabled", False)
    for unused in ("obs.depth", "obs.scan", "goal.low_dim", "goal.rgb", "goal.depth", "goal.scan"):
        keys.must(f"observation.modalities.{unused}", [])
    keys.must("observation.encoder.low_dim.core_class", None)
    keys.must("observation.encoder.low_dim.obs_randomizer_class", None)
