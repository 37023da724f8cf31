"""Planner files that are damaged or contradictory, or valid with sizes that are never trained."""

import copy
import json
import struct
from typing import Any

import numpy as np
from choices import Choices

from random_planner import planner_config, random_tensors

_TINY: dict[str, Any] = {
    "horizon": 3,
    "image_size": 6,
    "crop": 4,
    "latent": 2,
    "predictor": {"hidden": [3]},
    "decoder": {"hidden": 2},
    "encoder": {"type": "small", "channels": [2, 3], "pool": "spatial_softmax", "keypoints": 2, "feature": 2},
}
_VARIANTS: tuple[dict[str, Any], ...] = (
    {},
    {"encoder": {**_TINY["encoder"], "pool": "flatten", "feature_relu": True}},
    {"cameras": ["a", "b"], "modes": 2},
    {"outputs": "position", "predictor": {"hidden": []}},
)
_SIZES = (1, 2, 3, 15, 16, 17, 33, 64)
_LARGE = (100, 1000, 5000, 30000, 65535, 65536)
_VALUES: tuple[Any, ...] = (
    *(0, 1, 2, -1, 65536, 65537, 1 << 31, 1 << 32, 1 << 60, 1 << 64, -(1 << 63), 1.5, 1e308, 1e-45, 1e-320),
    *(float("nan"), float("inf"), "", "pose", "resnet18", "small", "flatten", None, True, [], {}, [0], [1, 2, 3]),
    *([1 << 60], ["a"], ["a", "a"], [None], [[]], {"mean": [0] * 3, "std": [1e308] * 3}, [1e39] * 3, [2] * 50),
)
_NUMBERS = (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 1e30, 1e-45, 0.0)


def hostile_file(choices: Choices) -> bytes:
    """The bytes of a planner file with up to three changes."""
    config = planner_config(**copy.deepcopy(_TINY))
    config |= copy.deepcopy(choices.pick(_VARIANTS))
    if choices.chance(3):
        _resize(choices, config)
    tensors = random_tensors(config, seed=choices.index(4))
    metadata = {"format": 1, "kind": "planner", "config": config}
    header: dict[str, Any] = {}
    end = 0
    for name, tensor in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [end, end + tensor.nbytes]}
        end += tensor.nbytes
    for _ in range(choices.index(4)):
        match choices.index(4):
            case 0 | 1:
                _change_config(choices, config)
            case 2:
                _change_tensor(choices, tensors)
            case _:
                _change_entry(choices, header)
    if choices.chance(12):
        metadata |= choices.pick(({"format": 2}, {"kind": "policy"}, {"config": None}, {"config": []}, {"format": -1}))
    text = json.dumps(metadata)
    if choices.chance(16):
        text = choices.pick(("", "{", "null", "[" * 5000, '"\\ud800"', text[: len(text) // 2]))
    header = {"__metadata__": {"ocplanner": text}} | header
    content = bytearray(json.dumps(header).encode())
    content = bytearray(struct.pack("<Q", len(content))) + content + b"".join(t.tobytes() for t in tensors.values())
    if choices.chance(5):
        _change_bytes(choices, content)
    return bytes(content)


def _resize(choices: Choices, config: dict[str, Any]) -> None:
    """Set other sizes. The tensors follow, so the file is valid unless a size is out of bounds."""
    sizes = _SIZES if choices.index(3) < 2 else _LARGE
    match choices.index(6):
        case 0:
            config["horizon"] = choices.pick((*_SIZES, *_LARGE))
        case 1:
            config["image_size"] = choices.pick(sizes)
            config["crop"] = min(config["image_size"], choices.pick((*_SIZES, *sizes)))
            if config["encoder"]["pool"] == "flatten" and config["crop"] > 200:
                config["crop"] = 200  # the tensor of the fully connected layer would be large
        case 2:
            config["latent"] = choices.pick(_SIZES)
        case 3:
            config["encoder"]["channels"] = [choices.pick(_SIZES) for _ in range(1 + choices.index(12))]
        case 4:
            config["decoder"]["hidden"] = choices.pick(_SIZES)
        case _:
            config["modes"] = choices.pick(_SIZES)


def _change_config(choices: Choices, config: dict[str, Any]) -> None:
    inside = choices.pick(("", "encoder", "normaliser", "predictor", "decoder"))
    part = config.get(inside, config) if inside else config
    if not isinstance(part, dict) or not part:
        return
    key = choices.pick(sorted(part))
    if choices.chance(6):
        del part[key]
    else:
        part[key] = choices.pick(_VALUES)


def _change_tensor(choices: Choices, tensors: dict[str, np.ndarray]) -> None:
    name = choices.pick(sorted(tensors))
    if tensors[name].size == 0:
        return
    if choices.chance(2):
        tensors[name].flat[choices.index(tensors[name].size)] = choices.pick(_NUMBERS)
    else:
        tensors[name][...] = choices.pick(_NUMBERS[3:])


def _change_entry(choices: Choices, header: dict[str, Any]) -> None:
    if not header:
        return
    name = choices.pick(sorted(header))
    entry = header[name]
    match choices.index(8):
        case 0:
            del header[name]
        case 1:
            header[f"{name}x"] = header.pop(name)
        case 2:
            entry["dtype"] = choices.pick(("F64", "F16", "BF16", "I8", "F4", "nothing", "", "BOOL"))
        case 3:
            entry["shape"] = choices.pick(([], [0], [1 << 62, 4], [1 << 63, 2], [-1], [1.5], [1 << 60, 0], [1] * 99))
        case 4:
            entry["data_offsets"] = choices.pick(([0, 0], [8, 4], [-1, 3], [0, 1 << 62], [1 << 63, 1 << 63], [0], []))
        case 5:
            entry["shape"] = [*entry["shape"], 1]
        case 6:
            entry["shape"] = entry["shape"][::-1]
        case _:
            header[f"{name}2"] = dict(entry)


def _change_bytes(choices: Choices, content: bytearray) -> None:
    match choices.index(5):
        case 0:
            del content[choices.index(len(content)) :]
        case 1:
            content += bytes(choices.index(64))
        case 2:
            content[:8] = struct.pack("<Q", choices.pick((0, 1, 7, 1 << 30, 1 << 62, (1 << 64) - 1, len(content))))
        case _:
            for _ in range(1 + choices.index(8)):
                content[choices.index(min(len(content), 4096))] = choices.index(256)
