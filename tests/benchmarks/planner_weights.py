"""A planner file's weights as every peer gets them: all constant arithmetic folded in."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open


@dataclass(frozen=True)
class PlannerWeights:
    """Configuration and folded float32 tensors of a planner with one mode that plans poses.

    Batch normalisation is folded into the convolutions by the file format already. Here the division of the pixels by
    255 goes into the first convolution, the temperature of the spatial softmax into the keypoints, the normaliser into
    the head, and the predicted standard deviations, which planning does not use, are left out.
    """

    config: dict[str, Any]
    tensors: dict[str, np.ndarray]

    @classmethod
    def load(cls, path: Path) -> "PlannerWeights":
        """Read a planner file.

        Raises:
            ValueError: it has several modes, or plans positions only.
        """
        with safe_open(path, framework="numpy") as file:
            config = json.loads(file.metadata()["ocplanner"])["config"]
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        if config.get("modes", 1) != 1 or config["outputs"] != "pose":
            raise ValueError(f"{path}: the peers cover planners of one mode that plan poses")
        return cls(config, _folded(config, tensors))

    def planning(self, steps: int) -> "PlannerWeights":
        """The same planner, planning only so many steps."""
        return PlannerWeights({**self.config, "horizon": steps}, self.tensors)

    @property
    def crop(self) -> tuple[int, int]:
        """First pixel and side of the centre crop."""
        return (self.config["image_size"] - self.config["crop"]) // 2, self.config["crop"]

    @property
    def predictor_layers(self) -> int:
        """Linear layers of the latent predictor."""
        return len(self.config["predictor"]["hidden"]) + 1

    def layer(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Weight and bias of a layer."""
        return self.tensors[f"{name}.weight"], self.tensors[f"{name}.bias"]


def _folded(config: dict[str, Any], tensors: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    folded = dict(tensors)

    def scale(name: str, factor: float) -> None:
        folded[name] = tensors[name] * np.float32(factor)

    encoder = config["encoder"]
    first = "conv.0" if encoder["type"] == "small" else "stem"
    for camera in config["cameras"]:
        scale(f"encoder.{camera}.{first}.weight", 1 / 255)
        if encoder["pool"] == "spatial_softmax":
            for part in ("weight", "bias"):
                scale(f"encoder.{camera}.keypoints.{part}", 1 / encoder.get("temperature", 1.0))
    last = f"predictor.{len(config['predictor']['hidden'])}"
    for part in ("weight", "bias"):
        folded[f"{last}.{part}"] = tensors[f"{last}.{part}"][: config["latent"]].copy()
    mean, std = (np.array(config["normaliser"][name], np.float32) for name in ("mean", "std"))
    weight, bias = tensors["decoder.head.weight"].copy(), tensors["decoder.head.bias"].copy()
    weight[:3] *= std[:, None]
    bias[:3] = bias[:3] * std + mean
    return folded | {"decoder.head.weight": weight, "decoder.head.bias": bias}
