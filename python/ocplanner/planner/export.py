"""Writing a trained network as a planner file.

A planner file is one safetensors file: float32 tensors in torch's layouts with batch normalisation folded into the
convolutions, and the configuration as JSON in the metadata under ``ocplanner``.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import cast

import numpy as np
import torch
from safetensors.torch import save
from torch import Tensor, nn

from ocplanner import _core
from ocplanner.errors import TrainingError
from ocplanner.files.records.planner import (
    DecoderHeader,
    EncoderHeader,
    NormaliserHeader,
    PlannerHeader,
    PredictorHeader,
    TrainingHeader,
)
from ocplanner.files.storage import atomic_write
from ocplanner.planner.augment import to_input
from ocplanner.planner.config import PlannerTraining
from ocplanner.planner.encoder import BasicBlock, ImageEncoder, ResNet18Trunk, SmallTrunk, SpatialSoftmax
from ocplanner.planner.frames import DataSettings
from ocplanner.planner.network import Normaliser, PlannerNetwork
from ocplanner.settings import to_dict

_TOLERANCE = 1e-3
"""Largest difference between the engine's and the network's plans: of positions in standard deviations of the training
data, of entries of rotation matrices, and of probabilities. Both compute in float32, where folding and another order
of summation cost about 1e-5; a layer that is exported wrongly costs far more. 1e-3 is about 0.1 mm."""


@dataclass(frozen=True)
class Provenance:
    """What a planner's header says about its data and its errors."""

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
    probe: Mapping[str, np.ndarray],
) -> None:
    """Write the planner file atomically, after checking that the engine plans from it as the network does.

    Args:
        network: the trained network.
        config: how it was trained.
        provenance: data settings, normaliser and held-out errors.
        path: the file to write.
        probe: {camera: (B, image_size, image_size, 3) uint8} images for the check.

    Raises:
        TrainingError: the engine's plans differ from the network's.
        OutputError: the file cannot be written.
    """
    network.eval()
    data = save(planner_tensors(network), metadata=planner_header(config, provenance).metadata())
    difference = _difference(_core.PlannerEngine(data), network, config, provenance.normaliser, probe)
    if not difference < _TOLERANCE:
        raise TrainingError(
            f"the exported planner differs from the trained network by {difference:.3g}; report this fault"
        )
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)


def _difference(
    engine: _core.PlannerEngine,
    network: PlannerNetwork,
    config: PlannerTraining,
    normaliser: Normaliser,
    probe: Mapping[str, np.ndarray],
) -> float:
    """The largest difference between the engine's and the network's plans, all modes; see ``_TOLERANCE``."""
    network = copy.deepcopy(network).cpu()  # a GPU may round convolutions to TF32
    with torch.inference_mode():
        images = {camera: to_input(image, config.network.crop) for camera, image in probe.items()}
        prediction = network.predictor(images)
        mu = prediction.latent.mu
        numbers = network.decoder(mu.flatten(0, 1)).unflatten(0, mu.shape[:2]).numpy()
        probability = prediction.logits.softmax(dim=1).numpy()
    found = engine.plan([np.ascontiguousarray(probe[camera]) for camera in config.cameras], all_modes=True)
    position, rotation = normaliser.decode(numbers)
    differences = [(found[0] - position) / normaliser.std, found[2] - probability]
    if rotation is not None and found[1] is not None:
        differences.append(found[1] - rotation)
    return max(float(np.abs(difference).max()) for difference in differences)


def planner_header(config: PlannerTraining, provenance: Provenance) -> PlannerHeader:
    """The header of the planner file."""
    network, encoder, settings = config.network, config.network.encoder, provenance.settings
    softmax = encoder.pool == "spatial_softmax"
    mean, std = provenance.normaliser.mean.tolist(), provenance.normaliser.std.tolist()
    return PlannerHeader(
        task=settings.task,
        object=settings.object_name,
        horizon=network.horizon,
        outputs=network.outputs,
        cameras=config.cameras,
        image_size=network.image_size,
        crop=network.crop,
        observe=config.observe,
        visual=settings.visual,
        mask_rgb=settings.mask_rgb,
        normaliser=NormaliserHeader(tuple(mean), tuple(std)),
        latent=network.latent,
        modes=network.modes,
        encoder=EncoderHeader(
            type=encoder.type,
            channels=encoder.channels if encoder.type == "small" else None,
            pool=encoder.pool,
            keypoints=encoder.keypoints if softmax else None,
            temperature=encoder.temperature if softmax else None,
            feature=encoder.feature,
            feature_relu=encoder.feature_relu,
        ),
        predictor=PredictorHeader(network.predictor_hidden),
        decoder=DecoderHeader(network.decoder_hidden),
        source_robot=settings.source_robot,
        control_freq=settings.control_freq,
        seed=config.seed,
        versions=_versions(),
        training=TrainingHeader(
            settings=to_dict(config),
            stage=provenance.kept_stage,
            data=provenance.data_digest,
            silhouettes=settings.silhouettes,
            held_out=provenance.held_out,
        ),
    )


def planner_tensors(network: PlannerNetwork) -> dict[str, Tensor]:
    """The file's tensors by name, float32 and contiguous."""
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


def _versions() -> dict[str, str]:
    found = {}
    for package in ("ocplanner", "torch", "robosuite", "mujoco"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "source"
    return found
