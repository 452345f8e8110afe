"""The trained networks as ONNX models with their manifests."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from dance2pose.onnx_models.manifest import Manifest, write_manifest
from demo_training.networks import (
    DETECTOR_INPUT,
    MEAN,
    POSE_INPUT,
    STD,
    ExportedDetector,
    ExportedPose,
)

FILES = {"detector": "demo_detector.onnx", "pose": "demo_pose.onnx"}
_SOURCE = "trained by scripts/train_demo_models.py on figures rendered from CMU motion capture"
_MEAN = tuple(round(255 * value, 3) for value in MEAN)
_STD = tuple(round(255 * value, 3) for value in STD)


def export(name: str, network: nn.Module, folder: Path) -> None:
    """Write `demo_<name>.onnx` and its manifest, replacing what is there."""
    path = folder / FILES[name]
    if name == "pose":
        model: nn.Module = ExportedPose(network)
        shape, outputs = (1, 3, *POSE_INPUT), ["heatmaps"]
    else:
        model = ExportedDetector(network)
        shape, outputs = (1, 3, DETECTOR_INPUT, DETECTOR_INPUT), ["boxes", "scores"]
    torch.onnx.export(
        model.eval(),
        (torch.zeros(shape),),
        str(path),
        input_names=["image"],
        output_names=outputs,
        dynamic_axes={"image": {0: "batch"}, **{key: {0: "batch"} for key in outputs}},
        opset_version=17,
        dynamo=False,
    )
    write_manifest(path.with_suffix(".toml"), _manifest(name), overwrite=True)


def _manifest(name: str) -> Manifest:
    common = {"mean": _MEAN, "std": _STD, "source": _SOURCE, "license": "Apache-2.0"}
    if name == "pose":
        return Manifest(
            kind="pose",
            form="heatmap",
            input_width=POSE_INPUT[1],
            input_height=POSE_INPUT[0],
            resize="crop",
            skeleton="coco23",
            refinement="dark",
            name="dance2pose demo keypoints",
            **common,
        )
    return Manifest(
        kind="detector",
        form="boxes-scores",
        input_width=DETECTOR_INPUT,
        input_height=DETECTOR_INPUT,
        resize="stretch",
        score_threshold=0.25,
        nms_threshold=0.5,
        name="dance2pose demo detector",
        **common,
    )
