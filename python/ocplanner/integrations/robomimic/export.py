"""A BC or BC-RNN checkpoint of robomimic as a policy file of ours: same networks, same numbers."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import torch
from robomimic.utils.file_utils import load_dict_from_checkpoint
from torch import Tensor

from ocplanner.errors import MismatchError, ModelFileError
from ocplanner.files.storage import check_output
from ocplanner.policies.actor import Actor
from ocplanner.policies.config import HINT_KEY, ObservationConfig
from ocplanner.policies.network import make_network
from ocplanner.policies.policy import save_policy
from ocplanner.policies.robomimic_config import parse_robomimic_config
from ocplanner.policies.train import read

_TRUNK = {"0": "conv1", "1": "bn1", **{str(4 + layer): f"layers.{layer}" for layer in range(4)}}
"""robomimic's ResNet18Conv is a sequence of torchvision's parts; ours have torchvision's names."""


def export_policy(checkpoint: Path, out: Path, data: Path | None = None) -> Path:
    """Write a policy file, which ``ocplanner evaluate`` rolls out, with live hints too.

    robomimic's checkpoints are unpickled: export only what you trust.

    Args:
        checkpoint: ``models/*.pth`` or ``last.pth`` of a run of robomimic's ``train.py``.
        out: policy file to write.
        data: the data set that it was trained on; by default the one that its configuration names.

    Returns:
        ``out``.

    Raises:
        ModelFileError: the file cannot be read, or is no checkpoint of robomimic.
        InvalidValueError: its configuration is none that our networks can honour.
        DatasetError: the data set is missing or damaged.
        MismatchError: no data set is named, or the checkpoint's weights are not those of its configuration.
        OutputError: the policy file cannot be written.
    """
    try:
        found = load_dict_from_checkpoint(str(checkpoint))
        weights, shapes = found["model"]["nets"], found["shape_metadata"]["all_shapes"]
        values = json.loads(found["config"])
    except Exception as error:  # unpickling raises anything
        raise ModelFileError(f"{checkpoint} is no checkpoint of robomimic's ({error})") from error
    given = parse_robomimic_config(values, checkpoint)
    data = data or given.data
    if data is None:
        raise MismatchError(f"{checkpoint} names no data set; give --data")
    seen, hinted = given.training.observation, given.training.network.hint is not None
    order = tuple(key for key in shapes if key in seen.low_dim and not (hinted and key == HINT_KEY))
    training = replace(given.training, observation=replace(seen, low_dim=order))
    recorded = read(training, data)
    header = recorded.header
    if header.action_range is not None:
        raise MismatchError(f"{data}: actions outside [-1, 1], which robomimic does not learn from; give its data set")
    actor = cast(Actor, make_network(training, header.low_dim, header.actions))
    # Everything else must come from the checkpoint: loading is strict.
    state = {"encoder.mean": actor.encoder.mean, "encoder.std": actor.encoder.std}
    try:
        state |= _scaling(order, found.get("obs_normalization_stats"))
        state |= _weights(actor, {name.removeprefix("policy.nets."): value for name, value in weights.items()})
        first = "lstm.weight_ih_l0" if training.algorithm == "bc-rnn" else "layers.0.weight"
        state[first] = state[first][:, _columns(training.observation, shapes)]
        actor.load_state_dict(state)
    except (KeyError, RuntimeError) as error:
        raise MismatchError(f"{checkpoint}: its weights are not those of its configuration: {error}") from error
    step = found["variable_state"]["epoch"] * (training.steps // max(1, values["train"]["num_epochs"]))
    check_output(out, True, "safetensors file", (checkpoint, data))
    save_policy(actor, replace(header, step=step, exported_from=checkpoint.name), out)
    return out


def _weights(actor: Actor, found: Mapping[str, Tensor]) -> Iterator[tuple[str, Tensor]]:
    """Our names and tensors, from robomimic's."""
    heads = ("mean", "scale", "logits")
    for kind in ("weight", "bias"):
        yield f"head.linear.{kind}", torch.cat([found[f"decoder.nets.{head}.{kind}"] for head in heads])
        if actor.hint is not None:
            yield f"hint.linear.{kind}", found[f"decoder.nets.hint_weights.{kind}"]
    for name, value in found.items():
        group, _, rest = name.partition(".")
        part = rest.split(".")
        if group == "mlp":  # _model.0, _model.2, ...: a ReLU between two layers
            yield f"layers.{int(part[1]) // 2}.{part[-1]}", value
        elif group == "rnn" and part[1].startswith(("weight", "bias")):
            yield f"lstm.{part[1]}", value
        elif group == "encoder" and (camera := _camera_weight(part)) is not None:
            yield camera, value


def _columns(seen: ObservationConfig, shapes: Mapping[str, Sequence[int]]) -> Tensor:
    """Where the features stand in robomimic's order, which mixes numbers and pictures, for ours: numbers first."""
    pictures = [f"{camera}_image" for camera in seen.cameras]
    widths = {key: seen.encoder.feature if key in pictures else math.prod(shape) for key, shape in shapes.items()}
    used = [key for key in shapes if key in (*seen.low_dim, *pictures)]
    columns = dict(zip(used, torch.arange(sum(widths[key] for key in used)).split([widths[key] for key in used])))
    return torch.cat([columns[key] for key in (*seen.low_dim, *pictures)])


def _camera_weight(part: list[str]) -> str | None:
    """Our name for ``nets.obs.obs_nets.CAMERA_image.nets.PLACE...``: backbone, pool, flatten, linear layer."""
    if len(part) < 7 or part[2] != "obs_nets" or part[4] != "nets":
        return None
    camera, place, rest = part[3].removesuffix("_image"), part[5], part[6:]
    if place == "0":
        return f"encoder.cameras.{camera}.trunk.{'.'.join([_TRUNK[rest[1]], *rest[2:]])}"
    if place == "1":
        return f"encoder.cameras.{camera}.pool.keypoints.{rest[-1]}" if rest[0] == "nets" else None
    return f"encoder.cameras.{camera}.fc.{rest[-1]}"


def _scaling(order: tuple[str, ...], stats: Mapping[str, Any] | None) -> dict[str, Tensor]:
    """Mean and standard deviation of the numbers, where robomimic normalised them."""
    if stats is None:
        return {}
    parts = {"mean": "offset", "std": "scale"}
    return {
        f"encoder.{ours}": torch.cat([torch.as_tensor(stats[key][theirs]).flatten() for key in order])
        for ours, theirs in parts.items()
    }
