"""A robomimic configuration by dotted keys: values are taken, checked or ignored, and what is left is unknown."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ocplanner.errors import InvalidValueError

IGNORED_KEYS: Mapping[str, tuple[str, ...] | None] = {
    "experiment": (
        *("name", "validate", "validation_epoch_every_n_steps", "env", "additional_envs", "render", "render_video"),
        *("keep_all_videos", "video_skip"),
    ),
    "experiment.logging": ("terminal_output_to_txt", "log_tb", "log_wandb", "wandb_proj_name"),
    "experiment.save": (
        *("every_n_seconds", "every_n_epochs", "epochs"),
        *("on_best_validation", "on_best_rollout_return", "on_best_rollout_success_rate"),
    ),
    "experiment.rollout": ("enabled", "n", "horizon", "rate", "warmstart", "terminate_on_success"),
    "experiment.env_meta_update_dict": None,
    "train": (
        *("output_dir", "normalize_weights_by_ds_size", "num_data_workers", "hdf5_cache_mode", "hdf5_use_swmr"),
        *("hdf5_load_next_obs", "hdf5_validation_filter_key", "pad_frame_stack", "dataset_keys"),
    ),
    "algo.loss": ("l2_weight", "l1_weight", "cos_weight"),
    "algo.gaussian": ("fixed_std", "init_std", "min_std", "std_activation", "low_noise_eval"),
    "algo.vae": (
        *("latent_dim", "latent_clip", "kl_weight", "encoder_layer_dims", "decoder_layer_dims", "prior_layer_dims"),
        *("decoder.is_conditioned", "decoder.reconstruction_sum_across_elements"),
        *("prior.learn", "prior.is_conditioned", "prior.use_gmm", "prior.gmm_num_modes", "prior.gmm_learn_weights"),
        *("prior.use_categorical", "prior.categorical_dim", "prior.categorical_gumbel_softmax_hard"),
        *("prior.categorical_init_temp", "prior.categorical_temp_anneal_step", "prior.categorical_min_temp"),
    ),
    "algo.rnn": ("rnn_type", "open_loop", "kwargs.bidirectional"),
    "algo.transformer": (
        *("context_length", "embed_dim", "num_layers", "num_heads", "emb_dropout", "attn_dropout"),
        *("block_output_dropout", "sinusoidal_embedding", "activation", "supervise_all_steps"),
        *("nn_parameter_for_timesteps", "pred_future_acs"),
    ),
    "observation.encoder.low_dim": ("core_kwargs", "obs_randomizer_kwargs"),
    "observation.encoder.rgb": ("core_class", "obs_randomizer_class"),
    "observation.encoder.depth": None,
    "observation.encoder.scan": None,
    "meta": ("hp_base_config_file", "hp_keys", "hp_values"),
}
"""Keys of robomimic 0.5 that do not change a training here, by group; None: the whole group, whatever is in it.

Those that an algorithm or the cameras use (of ``algo.rnn``, ``observation.encoder.rgb``) have been taken before.
"""

_KIND_NAMES = {int: "a whole number", float: "a number", bool: "true or false", str: "a name", list: "a list"}


class Keys:
    """The values of a configuration by dotted key. What is wrong with them is collected and raised at the end."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = dict(_flat(values))
        self._left = set(self._values)
        self._taken: set[str] = set()
        self._wrong: list[str] = []
        self._ignored: set[str] = set()

    def refuse(self, message: str) -> None:
        """Remember that something cannot be honoured."""
        self._wrong.append(message)

    def take(self, key: str, default: Any, kind: type | tuple[type, ...] | None = None) -> Any:
        """A value of the default's type, or of ``kind``; the default where it is absent or has another type."""
        self._left.discard(key)
        self._taken.add(key)
        value = self._values.get(key, default)
        kinds = kind or type(default)
        fits = isinstance(value, (int, float) if kinds is float else kinds)
        if isinstance(value, bool) and kinds is not bool:
            fits = False
        if value is default or fits:
            return value
        self.refuse(f"{key} {json.dumps(value)}: give {_KIND_NAMES.get(kinds, 'a value of another type')}")
        return default

    def count(self, key: str, default: int, least: int = 1) -> int:
        """A whole number of at least ``least``."""
        value = self.take(key, default)
        if value >= least:
            return value
        self.refuse(f"{key} {value} must be at least {least}")
        return default

    def counts(self, key: str, default: Sequence[int]) -> Sequence[int]:
        """A list of positive whole numbers."""
        value = self.take(key, default, list)
        if all(type(item) is int and item > 0 for item in value):
            return value
        self.refuse(f"{key} {json.dumps(value)}: give positive whole numbers")
        return default

    def positive(self, key: str, default: float | None) -> Any:
        """A positive number; None only where that is the default."""
        value = self.take(key, default, float)
        if value is None or value > 0:
            return value
        self.refuse(f"{key} {value} must be positive")
        return default

    def choice(self, key: str, default: str, known: tuple[str, ...]) -> Any:
        """One of some names."""
        value = self.take(key, default)
        if value in known:
            return value
        self.refuse(f"{key} {value!r}: known are {', '.join(known)}")
        return default

    def names(self, key: str, default: Sequence[str]) -> list[str]:
        """A list of different names."""
        value = self.take(key, default, list)
        if all(isinstance(item, str) for item in value) and len(set(value)) == len(value):
            return list(value)
        self.refuse(f"{key} {json.dumps(value)}: give names, each once")
        return list(default)

    _SAME: Any = object()

    def must(self, key: str, wanted: Any, default: Any = _SAME, remedy: str = "") -> None:
        """Refuse any other value; ``default`` is robomimic's where the key is left out (``wanted`` if not given)."""
        self._left.discard(key)
        value = self._values.get(key, wanted if default is Keys._SAME else default)
        if value != wanted:
            self.refuse(f"{key} is {json.dumps(value)}: {remedy or f'only {json.dumps(wanted)} can be honoured'}")

    def ignore(self, groups: Mapping[str, tuple[str, ...] | None]) -> None:
        """Leave keys by group without effect (None: all in the group), and remember which were there.

        A group of which no key has an effect is remembered as one.
        """
        for group, names in groups.items():
            inside = {key for key in self._left if key.startswith(f"{group}.")}
            if names is not None:
                inside &= {f"{group}.{name}" for name in names}
            self._left -= inside
            if inside:
                used = any(key.startswith(f"{group}.") for key in self._taken)
                self._ignored |= inside if used else {group}

    def finish(self, path: Path) -> tuple[str, ...]:
        """Names of the keys and groups that have no effect.

        Raises:
            InvalidValueError: a key is left that nobody asked for, or something was refused.
        """
        if self._left:
            self.refuse(f"unknown keys {', '.join(sorted(self._left))}: remove or correct them")
        if self._wrong:
            raise InvalidValueError(f"{path}: {'; '.join(self._wrong)}")
        return tuple(sorted(self._ignored))


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys of everything that is no mapping; an empty mapping says nothing."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
