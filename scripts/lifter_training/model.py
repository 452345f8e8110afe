"""The depth network in PyTorch, and its export to ONNX."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import onnx.helper
import onnx.numpy_helper
import torch
from torch import nn

from dance2pose.lifting.temporal.network import BONE_OUTPUTS, BONES, FEATURES, JOINTS, OUTPUTS

_TAPS = 5
_DILATIONS = (1, 2, 4, 2, 1, 4)


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
        normed = self.norm(x + filtered)
        # Half precision where it costs most and matters least, in training alone.
        with torch.autocast("cpu", torch.bfloat16, enabled=self.training):
            mixed = self.mix(normed)
        return x + mixed

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
    """Features (B, T, F) to joints (B, T, J, 5) and bones (B, T, J - 1, 2).

    See dance2pose.lifting.temporal.network.
    """

    def __init__(self, width: int = 384, blocks: int = 4) -> None:
        super().__init__()
        self.enter = nn.Linear(FEATURES, width)
        self.blocks = nn.ModuleList(Block(width, _DILATIONS[i]) for i in range(blocks))
        self.norm = nn.LayerNorm(width)
        self.leave = nn.Linear(width, JOINTS * OUTPUTS)
        self.bones = nn.Linear(width, BONES * BONE_OUTPUTS)

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        x = self.enter(features)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        joints = self.leave(x).unflatten(-1, (JOINTS, OUTPUTS))
        return joints, self.bones(x).unflatten(-1, (BONES, BONE_OUTPUTS))

    @torch.no_grad()
    def start_from(self, weights: dict[str, torch.Tensor]) -> None:
        """Take over the weights of a network with as many features and blocks or fewer.

        What is new adds nothing at first: new features are not looked at, new blocks change
        nothing.
        """
        mine = self.state_dict()
        for name, value in weights.items():
            mine[name][tuple(slice(0, size) for size in value.shape)] = value
        if (first := weights["enter.weight"].shape[1]) < FEATURES:
            mine["enter.weight"][:, first:] = 0
        for number in range(len(self.blocks)):
            if f"blocks.{number}.bias" not in weights:
                mine[f"blocks.{number}.mix.2.weight"][:] = 0
                mine[f"blocks.{number}.mix.2.bias"][:] = 0


def weights_of(path: Path) -> dict[str, torch.Tensor]:
    """The weights in a .pt of train_lifter.py, or in a lifter.onnx."""
    if path.suffix != ".onnx":
        return dict(torch.load(path, weights_only=True))
    graph = onnx.load(str(path)).graph
    arrays = {i.name: onnx.numpy_helper.to_array(i) for i in graph.initializer}
    named = {name: a for name, a in arrays.items() if not name.startswith("onnx::")}
    # The export transposes matrices and takes taps apart, and gives both numbers for names, in
    # the order of their use.
    rest = [arrays[name] for name in arrays if name.startswith("onnx::")]
    matrices = iter([a.T for a in rest if a.ndim == 2])
    taps = [a for a in rest if a.ndim == 1]
    blocks = len(taps) // _TAPS
    named["enter.weight"] = next(matrices)
    for block in range(blocks):
        named[f"blocks.{block}.taps"] = np.stack(taps[block * _TAPS : (block + 1) * _TAPS])
        named[f"blocks.{block}.mix.0.weight"] = next(matrices)
        named[f"blocks.{block}.mix.2.weight"] = next(matrices)
    named["leave.weight"] = next(matrices)
    if "bones.bias" in named:
        named["bones.weight"] = next(matrices)
    return {name: torch.from_numpy(np.array(a)) for name, a in named.items()}


def export(model: nn.Module, path: Path, takes: Sequence[str] = ()) -> None:
    """Write the network as ONNX with free batch and time axes, and the takes that it has seen."""
    model.eval()
    torch.onnx.export(
        model,
        (torch.zeros(2, 9, FEATURES),),
        str(path),
        input_names=["features"],
        output_names=["joints", "bones"],
        dynamic_axes={name: {0: "clips", 1: "frames"} for name in ("features", "joints", "bones")},
        opset_version=17,
        dynamo=False,
    )
    written = onnx.load(str(path))
    onnx.helper.set_model_props(written, {"training_takes": " ".join(sorted(takes))})
    onnx.save(written, str(path))
