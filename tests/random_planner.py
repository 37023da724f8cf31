"""Planner files with random weights, of any shape that the format allows."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import save_file

RESNET_CHANNELS = {1: 64, 2: 128, 3: 256, 4: 512}


def planner_config(**changes: Any) -> dict[str, Any]:
    """A complete configuration, small; ``encoder=...`` and other keys replace the defaults."""
    config: dict[str, Any] = {
        "task": "Square",
        "object": "SquareNut",
        "horizon": 6,
        "outputs": "pose",
        "cameras": ["agentview"],
        "image_size": 84,
        "crop": 76,
        "observe": "masked",
        "visual": "fast",
        "mask_rgb": [255, 0, 255],
        "normaliser": {"mean": [0.1, 0.05, 0.95], "std": [0.12, 0.09, 0.06]},
        "latent": 16,
        "modes": 1,
        "encoder": {
            "type": "small",
            "channels": [16, 32, 64],
            "pool": "spatial_softmax",
            "keypoints": 32,
            "feature": 64,
        },
        "predictor": {"hidden": [48]},
        "decoder": {"hidden": 32},
        "source_robot": "Panda",
        "seed": 0,
        "versions": {"ocplanner": "0.1.0"},
        "training": {},
    }
    return {**config, **changes}


def tensor_shapes(config: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """Name and shape of every tensor that the configuration asks for."""
    shapes: dict[str, tuple[int, ...]] = {}

    def layer(name: str, *shape: int) -> None:
        shapes[f"{name}.weight"] = shape
        shapes[f"{name}.bias"] = shape[:1]

    encoder = config["encoder"]
    for camera in config["cameras"]:
        prefix = f"encoder.{camera}"
        side = config["crop"]
        if encoder["type"] == "small":
            for index, (inputs, outputs) in enumerate(zip([3, *encoder["channels"]], encoder["channels"])):
                layer(f"{prefix}.conv.{index}", outputs, inputs, 3, 3)
                side = (side - 1) // 2 + 1
            channels = encoder["channels"][-1]
        else:
            layer(f"{prefix}.stem", 64, 3, 7, 7)
            side = (((side - 1) // 2 + 1) - 1) // 2 + 1
            inputs = 64
            for index, outputs in RESNET_CHANNELS.items():
                for block in range(2):
                    layer(f"{prefix}.layer{index}.{block}.conv1", outputs, inputs, 3, 3)
                    layer(f"{prefix}.layer{index}.{block}.conv2", outputs, outputs, 3, 3)
                    if index > 1 and block == 0:
                        layer(f"{prefix}.layer{index}.0.downsample", outputs, inputs, 1, 1)
                        side = (side - 1) // 2 + 1
                    inputs = outputs
            channels = 512
        if encoder["pool"] == "spatial_softmax":
            layer(f"{prefix}.keypoints", encoder["keypoints"], channels, 1, 1)
            flat = 2 * encoder["keypoints"]
        else:
            flat = channels * side * side
        layer(f"{prefix}.fc", encoder["feature"], flat)
    modes, latent, hidden = config["modes"], config["latent"], config["decoder"]["hidden"]
    inputs = encoder["feature"] * len(config["cameras"])
    last = 2 * modes * latent + (modes if modes > 1 else 0)
    for index, outputs in enumerate([*config["predictor"]["hidden"], last]):
        layer(f"predictor.{index}", outputs, inputs)
        inputs = outputs
    layer("decoder.init", 2 * hidden, latent)
    shapes["decoder.lstm.weight_ih"] = (4 * hidden, latent)
    shapes["decoder.lstm.weight_hh"] = (4 * hidden, hidden)
    shapes["decoder.lstm.bias"] = (4 * hidden,)
    layer("decoder.head", 9 if config["outputs"] == "pose" else 3, hidden)
    return shapes


def random_tensors(config: dict[str, Any], seed: int = 0) -> dict[str, np.ndarray]:
    """Float32 weights scaled so that activations keep their size through the layers."""
    rng = np.random.default_rng(seed)
    tensors = {}
    for name, shape in tensor_shapes(config).items():
        if name.endswith("bias"):
            values = 0.1 * rng.standard_normal(shape)
        else:
            gain = 0.5 if ".layer" in name else 2.0  # residual sums grow by themselves
            values = rng.standard_normal(shape) * np.sqrt(gain / np.prod(shape[1:]))
        tensors[name] = values.astype(np.float32)
    if config["outputs"] == "pose":
        tensors["decoder.head.bias"][3:] += np.array([1, 0, 0, 0, 1, 0], np.float32)
    return tensors


def write_planner(path: Path, config: dict[str, Any], tensors: dict[str, np.ndarray], **description: Any) -> Path:
    """Write a planner file; ``description`` replaces keys of its metadata."""
    metadata = {"format": 1, "kind": "planner", "config": config, **description}
    save_file(tensors, path, metadata={"ocplanner": json.dumps(metadata)})
    return path


def write_random_planner(path: Path, seed: int = 0, **changes: Any) -> dict[str, Any]:
    """Write a valid planner file with random weights; returns its configuration."""
    config = planner_config(**changes)
    write_planner(path, config, random_tensors(config, seed))
    return config


def random_images(config: dict[str, Any], batch: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random pixels for every camera of the configuration."""
    rng = np.random.default_rng(seed)
    size = config["image_size"]
    return {camera: rng.integers(0, 256, (batch, size, size, 3), dtype=np.uint8) for camera in config["cameras"]}
