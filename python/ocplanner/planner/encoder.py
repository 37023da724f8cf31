"""Image encoders: from one camera's image to a feature vector."""

import itertools

import torch
from torch import Tensor, nn

from ocplanner.planner.config import EncoderConfig


class SpatialSoftmax(nn.Module):
    """Expected image position of each of K learned keypoints (Finn et al.), as robomimic computes it.

    Input (B, C, h, w); output (B, 2K) as x0, y0, x1, y1, ... with x to the right and y down, both in [-1, 1].
    """

    def __init__(self, channels: int, height: int, width: int, keypoints: int, temperature: float) -> None:
        super().__init__()
        self.keypoints = nn.Conv2d(channels, keypoints, kernel_size=1)
        self.temperature = temperature
        y, x = torch.meshgrid(torch.linspace(-1, 1, height), torch.linspace(-1, 1, width), indexing="ij")
        self.register_buffer("grid", torch.stack([x.flatten(), y.flatten()], dim=-1), persistent=False)

    def forward(self, features: Tensor) -> Tensor:
        """Keypoint coordinates."""
        attention = (self.keypoints(features).flatten(2) / self.temperature).softmax(dim=-1)
        return (attention @ self.grid).flatten(1)


class SmallTrunk(nn.Module):
    """3x3 convolutions of stride 2, each followed by ReLU; four of them take a 76-pixel crop to 5x5."""

    def __init__(self, channels: tuple[int, ...], batch_norm: bool) -> None:
        super().__init__()
        inputs = (3, *channels[:-1])
        pairs = list(zip(inputs, channels))
        self.conv = nn.ModuleList([nn.Conv2d(i, o, 3, stride=2, padding=1, bias=not batch_norm) for i, o in pairs])
        self.norm = nn.ModuleList([nn.BatchNorm2d(o) if batch_norm else nn.Identity() for o in channels])

    def forward(self, image: Tensor) -> Tensor:
        """(B, 3, h, w) in [0, 1] to (B, C, h', w')."""
        for conv, norm in zip(self.conv, self.norm):
            image = torch.relu(norm(conv(image)))
        return image


class BasicBlock(nn.Module):
    """ResNet's two-convolution block."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample: nn.Sequential | None = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride=stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: Tensor) -> Tensor:
        """Residual block."""
        shortcut = x if self.downsample is None else self.downsample(x)
        x = torch.relu(self.bn1(self.conv1(x)))
        return torch.relu(self.bn2(self.conv2(x)) + shortcut)


class ResNet18Trunk(nn.Module):
    """ResNet18 without its average pool and classifier, not pretrained: robomimic's ResNet18Conv."""

    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.pool = nn.MaxPool2d(3, stride=2, padding=1)
        widths = (64, 64, 128, 256, 512)
        self.layers = nn.ModuleList(
            nn.Sequential(BasicBlock(i, o, 1 if o == i else 2), BasicBlock(o, o, 1))
            for i, o in itertools.pairwise(widths)
        )
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, image: Tensor) -> Tensor:
        """(B, 3, h, w) in [0, 1] to (B, 512, h', w')."""
        x = self.pool(torch.relu(self.bn1(self.conv1(image))))
        for layer in self.layers:
            x = layer(x)
        return x


class ImageEncoder(nn.Module):
    """Trunk, pooling and one linear layer: (B, 3, crop, crop) float32 in [0, 1] to (B, feature)."""

    def __init__(self, config: EncoderConfig, crop: int) -> None:
        super().__init__()
        small = config.type == "small"
        self.trunk: nn.Module = SmallTrunk(config.channels, config.batch_norm) if small else ResNet18Trunk()
        training = self.trunk.training
        with torch.no_grad():
            channels, height, width = self.trunk.eval()(torch.zeros(1, 3, crop, crop)).shape[1:]
        self.trunk.train(training)
        self.pool: nn.Module = nn.Flatten()
        inputs = channels * height * width
        if config.pool == "spatial_softmax":
            self.pool = SpatialSoftmax(channels, height, width, config.keypoints, config.temperature)
            inputs = 2 * config.keypoints
        self.fc = nn.Linear(inputs, config.feature)
        self.feature_relu = config.feature_relu

    def forward(self, image: Tensor) -> Tensor:
        """Feature vector of one camera's image."""
        feature = self.fc(self.pool(self.trunk(image)))
        return torch.relu(feature) if self.feature_relu else feature
