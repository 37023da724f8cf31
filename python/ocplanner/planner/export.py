"""Writing a trained network as a planner file.

A planner file is one safetensors file: float32 tensors in torch's layouts with batch normalisation folded into the
convolutions, and the configuration as JSON in the metadata under ``ocplanner``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, cast

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from ocplanner.errors import ModelFileError, TrainingError
from ocplanner.files.storage import atomic_write
from ocplanner.planner.config import PlannerTraining, to_dict
from ocplanner.planner.encoder import BasicBlock, ImageEncoder, ResNet18Trunk, SmallTrunk, SpatialSoftmax
from ocplanner.planner.frames import DataSettings
from ocplanner.planner.network import Normaliser, PlannerNetwork
from ocplanner.planner.reference import plan_with

FORMAT = 1
_TOLERANCE = 1e-3
"""Largest difference, in normalised units, that folding and float32 rounding may cause."""


@dataclass(frozen=True)
class Provenance:
    """What the file says beside the architecture: the data, the statistics and how good the plans are."""

    settings: DataSettings
    normaliser: Normaliser
    kept_stage: str
    held_out: Mapping[str, Mapping[str, float]]
    """Errors on held-out demonstrations by appearance, see :class:`ocplanner.planner.metrics.PlanErrors`."""
    data_digest: str


def export_planner(
    network: PlannerNetwork,
    config: PlannerTraining,
    provenance: Provenance,
    path: Path,
    probe: Mapping[str, Tensor],
) -> None:
    """Write the planner file atomically, after checking that it plans as the network does.

    Args:
        network: the trained network.
        config: how it was trained.
        provenance: data settings, normaliser and held-out errors.
        path: the file to write.
        probe: {camera: (B, 3, crop, crop)} images for the check.

    Raises:
        TrainingError: the file's plans differ from the network's.
        OutputError: the file cannot be written.
    """
    network.eval()
    tensors = planner_tensors(network)
    description = planner_config(config, provenance)
    images = {name: image.cpu() for name, image in probe.items()}
    with torch.inference_mode():
        ours, theirs = plan_with(tensors, description, images), network(probe).cpu()
    difference = float((ours - theirs).abs().max())
    if not difference < _TOLERANCE:
        raise TrainingError(
            f"the exported planner differs from the trained network by {difference:.3g}; report this fault"
        )
    metadata = {"ocplanner": json.dumps({"format": FORMAT, "kind": "planner", "config": description})}
    with atomic_write(path) as temporary:
        temporary.write_bytes(save(tensors, metadata=metadata))


def planner_config(config: PlannerTraining, provenance: Provenance) -> dict[str, Any]:
    """The configuration that travels in the file."""
    network, encoder, settings = config.network, config.network.encoder, provenance.settings
    small = {"channels": list(encoder.channels)} if encoder.type == "small" else {}
    pool = (
        {"keypoints": encoder.keypoints, "temperature": encoder.temperature}
        if encoder.pool == "spatial_softmax"
        else {}
    )
    return {
        "task": settings.task,
        "object": settings.object_name,
        "horizon": network.horizon,
        "outputs": network.outputs,
        "cameras": list(config.cameras),
        "image_size": network.image_size,
        "crop": network.crop,
        "observe": config.observe,
        "visual": settings.visual,
        "mask_rgb": None if settings.mask_rgb is None else list(settings.mask_rgb),
        "normaliser": {"mean": provenance.normaliser.mean.tolist(), "std": provenance.normaliser.std.tolist()},
        "latent": network.latent,
        "modes": network.modes,
        "encoder": {
            "type": encoder.type,
            **small,
            "pool": encoder.pool,
            **pool,
            "feature": encoder.feature,
            "feature_relu": encoder.feature_relu,
        },
        "predictor": {"hidden": list(network.predictor_hidden)},
        "decoder": {"hidden": network.decoder_hidden},
        "source_robot": settings.source_robot,
        "seed": config.seed,
        "versions": _versions(),
        "training": {
            "settings": to_dict(config),
            "stage": provenance.kept_stage,
            "data": provenance.data_digest,
            "silhouettes": list(settings.silhouettes),
            "held_out": {name: dict(errors) for name, errors in provenance.held_out.items()},
        },
    }


def planner_tensors(network: PlannerNetwork) -> dict[str, Tensor]:
    """Every tensor of the file by name, float32, contiguous."""
    tensors: dict[str, Tensor] = {}
    for camera, encoder in network.predictor.encoders.items():
        named = _encoder_tensors(cast(ImageEncoder, encoder))
        tensors |= {f"encoder.{camera}.{name}": tensor for name, tensor in named}
    for i, module in enumerate(network.predictor.layers):
        layer = cast(nn.Linear, module)
        tensors |= {f"predictor.{i}.weight": layer.weight, f"predictor.{i}.bias": layer.bias}
    decoder = network.decoder
    tensors |= {"decoder.init.weight": decoder.init.weight, "decoder.init.bias": decoder.init.bias}
    lstm = decoder.lstm
    weight_ih, weight_hh, bias_ih, bias_hh = cast(list[Tensor], lstm.all_weights[0])
    tensors |= {"decoder.lstm.weight_ih": weight_ih, "decoder.lstm.weight_hh": weight_hh}
    tensors["decoder.lstm.bias"] = bias_ih + bias_hh
    tensors |= {"decoder.head.weight": decoder.head.weight, "decoder.head.bias": decoder.head.bias}
    return {name: tensor.detach().float().cpu().contiguous() for name, tensor in tensors.items()}


def _encoder_tensors(encoder: ImageEncoder) -> list[tuple[str, Tensor]]:
    result: list[tuple[str, Tensor]] = []

    def convolution(name: str, conv: nn.Conv2d, norm: nn.Module) -> None:
        weight, bias = folded(conv, norm)
        result.extend([(f"{name}.weight", weight), (f"{name}.bias", bias)])

    trunk = encoder.trunk
    if isinstance(trunk, SmallTrunk):
        for i, (conv, norm) in enumerate(zip(trunk.conv, trunk.norm)):
            convolution(f"conv.{i}", cast(nn.Conv2d, conv), norm)
    elif isinstance(trunk, ResNet18Trunk):
        convolution("stem", trunk.conv1, trunk.bn1)
        for number, layer in enumerate(trunk.layers, start=1):
            for i, module in enumerate(cast(nn.Sequential, layer)):
                block = cast(BasicBlock, module)
                convolution(f"layer{number}.{i}.conv1", block.conv1, block.bn1)
                convolution(f"layer{number}.{i}.conv2", block.conv2, block.bn2)
                if block.downsample is not None:
                    shortcut, norm = block.downsample
                    convolution(f"layer{number}.{i}.downsample", cast(nn.Conv2d, shortcut), norm)
    if isinstance(encoder.pool, SpatialSoftmax):
        convolution("keypoints", encoder.pool.keypoints, nn.Identity())
    return [*result, ("fc.weight", encoder.fc.weight), ("fc.bias", encoder.fc.bias)]


def folded(conv: nn.Conv2d, norm: nn.Module) -> tuple[Tensor, Tensor]:
    """Weight and bias of a convolution followed by batch normalisation in evaluation mode (or by nothing)."""
    bias = torch.zeros_like(conv.weight[:, 0, 0, 0]) if conv.bias is None else conv.bias
    if not isinstance(norm, nn.BatchNorm2d) or norm.running_mean is None or norm.running_var is None:
        return conv.weight, bias
    scale = norm.weight.double() / torch.sqrt(norm.running_var.double() + norm.eps)
    weight = conv.weight.double() * scale[:, None, None, None]
    return weight.float(), ((bias.double() - norm.running_mean.double()) * scale + norm.bias.double()).float()


def read_planner_file(path: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Configuration and tensors of a planner file.

    Raises:
        ModelFileError: the file is missing, damaged, or no planner of this format.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads((file.metadata() or {})["ocplanner"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, ValueError) as error:
        raise ModelFileError(
            f"{path} is no planner file ({error}); write one with `ocplanner train-planner`"
        ) from error
    if header.get("kind") != "planner" or header.get("format") != FORMAT:
        found = f"{header.get('kind')} of format {header.get('format')}"
        raise ModelFileError(f"{path} holds a {found}, expected a planner of format {FORMAT}")
    return header["config"], tensors


def _versions() -> dict[str, str]:
    found = {}
    for package in ("ocplanner", "torch", "robosuite", "mujoco"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "source"
    return found
