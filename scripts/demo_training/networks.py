"""The two small networks, as they are trained and as they are exported.

Both are an encoder of plain residual convolutions (what a processor without a GPU runs and trains
fastest) and a decoder that brings coarse features back to fine ones.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
KEYPOINTS = 23
# Keypoint model: input and heatmap (height, width), px; spread of the target, heatmap cells.
POSE_INPUT, POSE_HEATMAP, SPREAD = (160, 120), (40, 30), 1.2
DETECTOR_INPUT, DETECTOR_STRIDE = 224, 8


def _conv(inputs: int, outputs: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class _Block(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _conv(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


class Encoder(nn.Module):
    """Features at strides 4, 8, 16 and 32, and the decoded ones at the finest wanted."""

    def __init__(self, channels: tuple[int, ...], blocks: tuple[int, ...], finest: int) -> None:
        super().__init__()
        self.stem = nn.Sequential(
            _conv(3, channels[0] // 2, stride=2), _conv(channels[0] // 2, channels[0], stride=2)
        )
        self.stages = nn.ModuleList(
            nn.Sequential(_conv(a, b, stride=2), *(_Block(b) for _ in range(n)))
            for a, b, n in zip(channels, channels[1:], blocks, strict=False)
        )
        levels = list(range(len(channels) - 2, finest - 1, -1))
        self.narrow = nn.ModuleList(nn.Conv2d(channels[i + 1], channels[i], 1) for i in levels)
        self.merge = nn.ModuleList(_conv(channels[i], channels[i]) for i in levels)
        self.levels = levels

    def forward(self, x: Tensor) -> Tensor:
        features = [self.stem(x)]
        for stage in self.stages:
            features.append(stage(features[-1]))
        out = features[-1]
        for level, narrow, merge in zip(self.levels, self.narrow, self.merge, strict=True):
            size = features[level].shape[-2:]
            coarse = functional.interpolate(narrow(out), size=size, mode="nearest")
            out = merge(features[level] + coarse)
        return out


class PoseNetwork(nn.Module):
    """Pictures (N, 3, 160, 120) to logits (N, 23, 40, 30), a softmax over each map."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder((32, 56, 96, 144), (1, 2, 1), finest=0)
        self.head = nn.Conv2d(32, KEYPOINTS, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.head(self.encoder(x))


class ExportedPose(nn.Module):
    """The keypoint model as users run it: heatmaps (N, 23, 40, 30) from 0 to 1.

    The value is the square root of the probability over what a sharp answer would have: as wide
    as a heatmap trained in the usual way, and its peak is a confidence.
    """

    def __init__(self, network: PoseNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor) -> Tensor:
        logits = self.network(x)
        probability = functional.softmax(logits.flatten(2), dim=2).view_as(logits)
        return torch.sqrt(probability * (2 * torch.pi * SPREAD**2)).clamp(max=1.0)


class DetectorNetwork(nn.Module):
    """Pictures (N, 3, 224, 224) to (N, 5, 28, 28): a person's middle (logit), and the distances to
    the left, top, right and bottom of the box (log of strides)."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder((16, 32, 64, 96, 96), (0, 1, 1, 1), finest=1)
        self.head = nn.Sequential(_conv(32, 48), nn.Conv2d(48, 5, 1))
        nn.init.constant_(self.head[1].bias[:1], -4.0)
        nn.init.constant_(self.head[1].bias[1:], 1.5)

    def forward(self, x: Tensor) -> Tensor:
        return self.head(self.encoder(x))


def boxes_of(output: Tensor) -> Tensor:
    """Boxes xyxy (N, H, W, 4) in input pixels from the network's output."""
    height, width = output.shape[-2:]
    y = (torch.arange(height, device=output.device) + 0.5).view(1, height, 1)
    x = (torch.arange(width, device=output.device) + 0.5).view(1, 1, width)
    left, top, right, bottom = output[:, 1:].clamp(-4, 4).exp().unbind(1)
    return DETECTOR_STRIDE * torch.stack([x - left, y - top, x + right, y + bottom], -1)


class ExportedDetector(nn.Module):
    """The detector as users run it: boxes (N, 784, 4) xyxy px and scores (N, 1, 784)."""

    def __init__(self, network: DetectorNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        output = self.network(x)
        return boxes_of(output).flatten(1, 2), torch.sigmoid(output[:, :1]).flatten(2)
