"""Models in 8-bit numbers: written with their manifest, their loss measured on the user's video."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from dance2pose.errors import UsageError
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.quantising import quantise
from onnx_graphs import emitting, save, tensor
from video_making import numbered_video


def detector(folder: Path) -> Path:
    dets = np.array([[[5, 5, 60, 90, 0.9], [40, 8, 90, 88, 0.8]]], np.float32)
    values = {"dets": dets, "labels": np.zeros((1, 2), np.int64)}
    return emitting(folder / "det.onnx", values, input_shape=(1, 3, 96, 96))


def convolving_pose(folder: Path) -> Path:
    """17 heatmaps, each a convolution of the picture."""
    weights = np.random.default_rng(2).normal(0, 0.2, (17, 3, 4, 4)).astype(np.float32)
    node = helper.make_node("Conv", ["input", "w"], ["heatmaps"], strides=[4, 4])
    squashed = helper.make_node("Sigmoid", ["heatmaps"], ["out"])
    return save(
        folder / "pose.onnx",
        [node, squashed],
        [tensor("input", np.float32, [1, 3, 64, 48])],
        [tensor("out", np.float32, [1, 17, 16, 12])],
        {"w": weights},
    )


def test_a_model_is_written_with_its_manifest_and_its_loss_said(tmp_path: Path) -> None:
    video = numbered_video(tmp_path / "v.mp4")
    model, out = convolving_pose(tmp_path), tmp_path / "small.onnx"
    loss = quantise(model, video, out, detector=detector(tmp_path))
    assert inspect_model(out).manifest_file == out.with_suffix(".toml")
    assert inspect_model(out).manifest.mean == inspect_model(model).manifest.mean
    assert loss.found > 0
    assert 0 <= loss.moved_px < 30
    assert "ms before" in str(loss)


def test_a_keypoint_model_needs_a_detector_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--detector"):
        quantise(convolving_pose(tmp_path), tmp_path / "v.mp4", tmp_path / "small.onnx")
    assert not (tmp_path / "small.onnx").exists()
