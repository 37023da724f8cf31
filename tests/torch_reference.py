"""The planner's forward pass in torch float64, written from the file format alone."""

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

Tensors = dict[str, torch.Tensor]


def reference(
    config: dict[str, Any], arrays: dict[str, np.ndarray], images: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """All modes: ``position`` (B, M, H, 3), ``rotation`` (B, M, H, 3, 3) or None, ``probability`` and ``latent``."""
    tensors = {name: torch.from_numpy(array).double() for name, array in arrays.items()}
    features = torch.cat([_encode(config, tensors, name, images[name]) for name in config["cameras"]], 1)
    layers = len(config["predictor"]["hidden"]) + 1
    for index in range(layers):
        features = _linear(tensors, f"predictor.{index}", features)
        if index + 1 < layers:
            features = torch.relu(features)
    batch, modes, latent = len(features), config["modes"], config["latent"]
    mu = features[:, : 2 * modes * latent].reshape(batch, modes, 2, latent)[:, :, 0]
    logits = features[:, 2 * modes * latent :] if modes > 1 else torch.zeros(batch, 1, dtype=torch.float64)
    steps = _decode(config, tensors, mu.reshape(batch * modes, latent))
    steps = steps.reshape(batch, modes, config["horizon"], -1).numpy()
    normaliser = config["normaliser"]
    rotation = None
    if config["outputs"] == "pose":
        a1, a2 = steps[..., 3:6], steps[..., 6:9]
        b1 = a1 / np.linalg.norm(a1, axis=-1, keepdims=True)
        b2 = a2 - (b1 * a2).sum(-1, keepdims=True) * b1
        b2 /= np.linalg.norm(b2, axis=-1, keepdims=True)
        rotation = np.stack([b1, b2, np.cross(b1, b2)], -1)
    return {
        "position": steps[..., :3] * np.array(normaliser["std"]) + np.array(normaliser["mean"]),
        "rotation": rotation,
        "probability": torch.softmax(logits, 1).numpy(),
        "latent": mu.numpy(),
    }


def _linear(tensors: Tensors, name: str, x: torch.Tensor) -> torch.Tensor:
    return F.linear(x, tensors[f"{name}.weight"], tensors[f"{name}.bias"])


def _conv(tensors: Tensors, name: str, x: torch.Tensor, stride: int, padding: int) -> torch.Tensor:
    return F.conv2d(x, tensors[f"{name}.weight"], tensors[f"{name}.bias"], stride, padding)


def _encode(config: dict[str, Any], tensors: Tensors, camera: str, images: np.ndarray) -> torch.Tensor:
    encoder, prefix = config["encoder"], f"encoder.{camera}"
    inset = (config["image_size"] - config["crop"]) // 2
    side = slice(inset, inset + config["crop"])
    x = torch.from_numpy(images[:, side, side].astype(np.float64)).permute(0, 3, 1, 2) / 255.0
    if encoder["type"] == "small":
        for index in range(len(encoder["channels"])):
            x = torch.relu(_conv(tensors, f"{prefix}.conv.{index}", x, 2, 1))
    else:
        x = F.max_pool2d(torch.relu(_conv(tensors, f"{prefix}.stem", x, 2, 3)), 3, 2, 1)
        for layer in range(1, 5):
            for block in range(2):
                name = f"{prefix}.layer{layer}.{block}"
                shrinks = layer > 1 and block == 0
                shortcut = _conv(tensors, f"{name}.downsample", x, 2, 0) if shrinks else x
                middle = torch.relu(_conv(tensors, f"{name}.conv1", x, 2 if shrinks else 1, 1))
                x = torch.relu(_conv(tensors, f"{name}.conv2", middle, 1, 1) + shortcut)
    if encoder["pool"] == "spatial_softmax":
        x = _conv(tensors, f"{prefix}.keypoints", x, 1, 0)
        height, width = x.shape[-2:]
        weight = torch.softmax(x.flatten(2) / encoder.get("temperature", 1.0), 2).unflatten(2, (height, width))
        expected_x = (weight.sum(2) * torch.from_numpy(np.linspace(-1, 1, width))).sum(-1)
        expected_y = (weight.sum(3) * torch.from_numpy(np.linspace(-1, 1, height))).sum(-1)
        x = torch.stack([expected_x, expected_y], 2)
    x = _linear(tensors, f"{prefix}.fc", x.flatten(1))
    return torch.relu(x) if encoder.get("feature_relu") else x


def _decode(config: dict[str, Any], tensors: Tensors, latents: torch.Tensor) -> torch.Tensor:
    hidden = config["decoder"]["hidden"]
    h, c = torch.tanh(_linear(tensors, "decoder.init", latents)).split(hidden, 1)
    lstm = torch.nn.LSTM(latents.shape[1], hidden, batch_first=True).double()
    state = {
        "weight_ih_l0": tensors["decoder.lstm.weight_ih"],
        "weight_hh_l0": tensors["decoder.lstm.weight_hh"],
        "bias_ih_l0": tensors["decoder.lstm.bias"],
        "bias_hh_l0": torch.zeros_like(tensors["decoder.lstm.bias"]),
    }
    lstm.load_state_dict(state)
    inputs = latents[:, None].expand(-1, config["horizon"], -1)
    with torch.no_grad():
        outputs, _ = lstm(inputs, (h[None].contiguous(), c[None].contiguous()))
    return _linear(tensors, "decoder.head", outputs)
