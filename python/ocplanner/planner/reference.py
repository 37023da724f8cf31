"""The planner file's format spelt out with plain torch operations: what every other implementation must agree with."""

from collections.abc import Mapping
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor


def plan_with(tensors: Mapping[str, Tensor], config: Mapping[str, Any], images: Mapping[str, Tensor]) -> Tensor:
    """(B, H, 3 or 9) normalised plans of the most probable mode: the reference for other implementations.

    Args:
        tensors: a planner file's tensors.
        config: its configuration.
        images: {camera: (B, 3, crop, crop)} float32 in [0, 1].
    """
    features = []
    for camera in config["cameras"]:
        prefix = f"encoder.{camera}."
        own = {name[len(prefix) :]: tensor for name, tensor in tensors.items() if name.startswith(prefix)}
        features.append(_feature(own, config["encoder"], images[camera]))
    x = torch.cat(features, dim=1)
    layers = len(config["predictor"]["hidden"])
    for i in range(layers):
        x = torch.relu(F.linear(x, tensors[f"predictor.{i}.weight"], tensors[f"predictor.{i}.bias"]))
    x = F.linear(x, tensors[f"predictor.{layers}.weight"], tensors[f"predictor.{layers}.bias"])
    modes, latent = config["modes"], config["latent"]
    mu = x[:, : modes * 2 * latent].reshape(-1, modes, 2, latent)[:, :, 0]
    best = x[:, modes * 2 * latent :].argmax(dim=1) if modes > 1 else torch.zeros(len(x), dtype=torch.long)
    return _decode(tensors, mu[torch.arange(len(x)), best], config["horizon"])


def _decode(tensors: Mapping[str, Tensor], z: Tensor, horizon: int) -> Tensor:
    start = F.linear(z, tensors["decoder.init.weight"], tensors["decoder.init.bias"])
    hidden, cell = torch.tanh(start).chunk(2, dim=1)
    inputs = F.linear(z, tensors["decoder.lstm.weight_ih"], tensors["decoder.lstm.bias"])
    steps = []
    for _ in range(horizon):
        i, f, g, o = (inputs + hidden @ tensors["decoder.lstm.weight_hh"].T).chunk(4, dim=1)
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
        hidden = torch.sigmoid(o) * torch.tanh(cell)
        steps.append(F.linear(hidden, tensors["decoder.head.weight"], tensors["decoder.head.bias"]))
    return torch.stack(steps, dim=1)


def _feature(tensors: Mapping[str, Tensor], config: Mapping[str, Any], image: Tensor) -> Tensor:
    x = _small(tensors, config, image) if config["type"] == "small" else _resnet18(tensors, image)
    if config["pool"] == "spatial_softmax":
        scores = F.conv2d(x, tensors["keypoints.weight"], tensors["keypoints.bias"]) / config["temperature"]
        attention = scores.flatten(2).softmax(dim=2).unflatten(2, scores.shape[2:])
        across = (attention.sum(dim=2) * torch.linspace(-1, 1, scores.shape[3])).sum(dim=2)
        down = (attention.sum(dim=3) * torch.linspace(-1, 1, scores.shape[2])).sum(dim=2)
        x = torch.stack([across, down], dim=2)
    feature = F.linear(x.flatten(1), tensors["fc.weight"], tensors["fc.bias"])
    return torch.relu(feature) if config["feature_relu"] else feature


def _small(tensors: Mapping[str, Tensor], config: Mapping[str, Any], x: Tensor) -> Tensor:
    for i in range(len(config["channels"])):
        x = torch.relu(F.conv2d(x, tensors[f"conv.{i}.weight"], tensors[f"conv.{i}.bias"], stride=2, padding=1))
    return x


def _resnet18(tensors: Mapping[str, Tensor], x: Tensor) -> Tensor:
    def convolution(name: str, x: Tensor, stride: int, padding: int) -> Tensor:
        return F.conv2d(x, tensors[f"{name}.weight"], tensors[f"{name}.bias"], stride=stride, padding=padding)

    x = F.max_pool2d(torch.relu(convolution("stem", x, 2, 3)), 3, stride=2, padding=1)
    for layer in (1, 2, 3, 4):
        for block in (0, 1):
            name, stride = f"layer{layer}.{block}", 2 if layer > 1 and block == 0 else 1
            shortcut = convolution(f"{name}.downsample", x, stride, 0) if f"{name}.downsample.weight" in tensors else x
            x = torch.relu(convolution(f"{name}.conv1", x, stride, 1))
            x = torch.relu(convolution(f"{name}.conv2", x, 1, 1) + shortcut)
    return x
