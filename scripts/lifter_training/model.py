"""The depth network in PyTorch, and its export to ONNX."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from dance2pose.lifting.temporal.network import FEATURES, JOINTS, OUTPUTS

_TAPS = 5
_DILATIONS = (1, 2, 4, 1, 2, 4)


class Block(nn.Module):
    """Each channel filtered in time, then all channels mixed frame by frame; residual."""

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.dilation = dilation
        self.taps = nn.Parameter(torch.randn(_TAPS, width) * 0.3)
        self.bias = nn.Parameter(torch.zeros(width))
        self.norm = nn.LayerNorm(width)
        self.mix = nn.Sequential(
            nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width)
        )
        with torch.no_grad():
            self.mix[2].weight.mul_(0.5)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        filtered = self.bias + self.in_time(x)
        return x + self.mix(self.norm(x + filtered))

    def in_time(self, x: torch.Tensor) -> torch.Tensor:
        """A depthwise convolution, written as a sum: PyTorch's own is slow on processors."""
        reach, frames = self.dilation * (_TAPS // 2), x.shape[1]
        if self.training and frames == 1:
            return x * self.taps.sum(dim=0)
        first, last = x[:, :1].expand(-1, reach, -1), x[:, -1:].expand(-1, reach, -1)
        padded = torch.cat([first, x, last], dim=1)
        filtered = torch.zeros_like(x)
        for tap in range(_TAPS):
            start = tap * self.dilation
            filtered = filtered + self.taps[tap] * padded[:, start : start + frames]
        return filtered


class DepthNetwork(nn.Module):
    """Features (B, T, F) to outputs (B, T, J, 5); see dance2pose.lifting.temporal.network."""

    def __init__(self, width: int = 384, blocks: int = 4) -> None:
        super().__init__()
        self.enter = nn.Linear(FEATURES, width)
        self.blocks = nn.ModuleList(Block(width, _DILATIONS[i]) for i in range(blocks))
        self.norm = nn.LayerNorm(width)
        self.leave = nn.Linear(width, JOINTS * OUTPUTS)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        x = self.enter(features)
        for block in self.blocks:
            x = block(x)
        return self.leave(self.norm(x)).unflatten(-1, (JOINTS, OUTPUTS))


def export(model: nn.Module, path: Path) -> None:
    """Write the network as ONNX with free batch and time axes."""
    model.eval()
    torch.onnx.export(
        model,
        (torch.zeros(2, 9, FEATURES),),
        str(path),
        input_names=["features"],
        output_names=["joints"],
        dynamic_axes={"features": {0: "clips", 1: "frames"}, "joints": {0: "clips", 1: "frames"}},
        opset_version=17,
        dynamo=False,
    )
