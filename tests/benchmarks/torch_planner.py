"""The planner as a torch module: uint8 images in, plans in metres and rotation matrices out."""

from collections.abc import Callable
from functools import partial

import torch
import torch.nn.functional as F
from planner_weights import PlannerWeights
from torch import nn


class TorchPlanner(nn.Module):
    """Forward pass in float32.

    Args:
        weights: of the planner.
        as_trained: the network as training leaves it, batch normalisation apart and images in torch's own layout;
            else with normalisation folded and in channels-last, which the images' own layout already is.
    """

    def __init__(self, weights: PlannerWeights, *, as_trained: bool = False) -> None:
        super().__init__()
        self.as_trained = as_trained
        self.config = weights.config
        self.inset, self.side = weights.crop
        self.encoders = nn.ModuleList(_Encoder(weights, camera, as_trained) for camera in self.config["cameras"])
        self.predictor = nn.Sequential()
        for index in range(weights.predictor_layers):
            if index > 0:
                self.predictor.append(nn.ReLU())
            self.predictor.append(_linear(weights, f"predictor.{index}"))
        self.decoder = _Decoder(weights)
        self.to(memory_format=torch.contiguous_format if as_trained else torch.channels_last).eval()

    def forward(self, images: list[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        """Images, one (B, h, w, 3) uint8 a camera, to positions (B, H, 3) and rotations (B, H, 3, 3)."""
        kept = slice(self.inset, self.inset + self.side)
        pixels = [image[:, kept, kept].permute(0, 3, 1, 2).float() for image in images]
        if self.as_trained:
            pixels = [image.contiguous() for image in pixels]
        features = [encoder(image) for encoder, image in zip(self.encoders, pixels)]
        joined = features[0] if len(features) == 1 else torch.cat(features, 1)
        steps = self.decoder(self.predictor(joined))
        b1 = F.normalize(steps[..., 3:6], dim=-1)
        a2 = steps[..., 6:]
        b2 = F.normalize(a2 - (b1 * a2).sum(-1, keepdim=True) * b1, dim=-1)
        return steps[..., :3], torch.stack([b1, b2, torch.linalg.cross(b1, b2)], -1)


class _Encoder(nn.Module):
    def __init__(self, weights: PlannerWeights, camera: str, as_trained: bool) -> None:
        super().__init__()
        encoder, prefix = weights.config["encoder"], f"encoder.{camera}"
        conv = partial(_normalised_conv if as_trained else _conv, weights)
        if encoder["type"] == "small":
            self.trunk = nn.Sequential()
            for index in range(len(encoder["channels"])):
                self.trunk.extend([conv(f"{prefix}.conv.{index}", 2, 1), nn.ReLU()])
        else:
            self.trunk = nn.Sequential(conv(f"{prefix}.stem", 2, 3), nn.ReLU(), nn.MaxPool2d(3, 2, 1))
            for layer in range(1, 5):
                for block in range(2):
                    self.trunk.append(_Block(conv, f"{prefix}.layer{layer}.{block}", layer > 1 and block == 0))
        self.keypoints = None
        if encoder["pool"] == "spatial_softmax":
            self.keypoints = _conv(weights, f"{prefix}.keypoints", 1, 0)
        self.fc = _linear(weights, f"{prefix}.fc")
        self.relu = encoder.get("feature_relu", False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.trunk(x)
        if self.keypoints is not None:
            x = self.keypoints(x)
            height, width = x.shape[-2:]
            weight = torch.softmax(x.flatten(2), 2)
            y, x = torch.meshgrid(torch.linspace(-1, 1, height), torch.linspace(-1, 1, width), indexing="ij")
            x = weight @ torch.stack([x.flatten(), y.flatten()], 1)
        x = self.fc(x.flatten(1))
        return torch.relu(x) if self.relu else x


class _Block(nn.Module):
    def __init__(self, conv: Callable[[str, int, int], nn.Module], name: str, shrinks: bool) -> None:
        super().__init__()
        self.conv1 = conv(f"{name}.conv1", 2 if shrinks else 1, 1)
        self.conv2 = conv(f"{name}.conv2", 1, 1)
        self.downsample = conv(f"{name}.downsample", 2, 0) if shrinks else nn.Identity()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.relu_(self.conv2(torch.relu_(self.conv1(x))) + self.downsample(x))


class _Decoder(nn.Module):
    def __init__(self, weights: PlannerWeights) -> None:
        super().__init__()
        hidden, latent = weights.config["decoder"]["hidden"], weights.config["latent"]
        self.horizon = weights.config["horizon"]
        self.init = _linear(weights, "decoder.init")
        self.lstm = nn.LSTM(latent, hidden)
        self.head = _linear(weights, "decoder.head")
        bias = torch.from_numpy(weights.tensors["decoder.lstm.bias"])
        self.lstm.load_state_dict(
            {
                "weight_ih_l0": torch.from_numpy(weights.tensors["decoder.lstm.weight_ih"]),
                "weight_hh_l0": torch.from_numpy(weights.tensors["decoder.lstm.weight_hh"]),
                "bias_ih_l0": bias,
                "bias_hh_l0": torch.zeros_like(bias),
            }
        )

    def forward(self, latent: torch.Tensor) -> torch.Tensor:
        h, c = torch.tanh(self.init(latent)).chunk(2, 1)
        inputs = latent.expand(self.horizon, -1, -1)
        outputs, _ = self.lstm(inputs, (h[None].contiguous(), c[None].contiguous()))
        return self.head(outputs).transpose(0, 1)


def _conv(weights: PlannerWeights, name: str, stride: int, padding: int) -> nn.Conv2d:
    weight, bias = (torch.from_numpy(array) for array in weights.layer(name))
    conv = nn.Conv2d(weight.shape[1], weight.shape[0], weight.shape[2], stride, padding)
    conv.load_state_dict({"weight": weight, "bias": bias})
    return conv


def _normalised_conv(weights: PlannerWeights, name: str, stride: int, padding: int) -> nn.Sequential:
    """The same, its bias in a batch normalisation that does nothing else."""
    conv = _conv(weights, name, stride, padding)
    norm = nn.BatchNorm2d(conv.out_channels, eps=0.0)
    if conv.bias is not None:
        norm.load_state_dict({"bias": conv.bias.detach()}, strict=False)
        conv.bias = None
    return nn.Sequential(conv, norm)


def _linear(weights: PlannerWeights, name: str) -> nn.Linear:
    weight, bias = (torch.from_numpy(array) for array in weights.layer(name))
    linear = nn.Linear(weight.shape[1], weight.shape[0])
    linear.load_state_dict({"weight": weight, "bias": bias})
    return linear
