"""Faults of ONNX models: each is caused here, and each ends in one clear ModelError."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dance2pose.detection import load_detector
from dance2pose.errors import ModelError
from dance2pose.keypoints import KeypointEstimator, load_pose_model
from dance2pose.onnx_models.answers import losses
from dance2pose.onnx_models.inference import open_session
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.poses import Boxes
from onnx_graphs import (
    allocating,
    dividing,
    emitting,
    unknown_operator,
    with_external_data,
)


def refusal(path: Path) -> str:
    """The message with which a model is refused: one line, naming the file."""
    with pytest.raises(ModelError) as refused:
        inspect_model(path)
    message = str(refused.value)
    assert path.name in message
    assert "\n" not in message
    return message


def test_missing_file_and_folder_and_empty_file(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "missing.onnx")
    assert "is a folder" in refusal(tmp_path)
    assert "cannot be read" in refusal(tmp_path / ("long" * 100 + ".onnx"))
    assert "cannot be read" in refusal(tmp_path / "nul\0.onnx")
    with pytest.raises(ModelError, match="is a folder"):
        inspect_model(Path())
    (tmp_path / "empty.onnx").touch()
    assert "is empty" in refusal(tmp_path / "empty.onnx")


@pytest.mark.parametrize("content", [b"these are not weights\n" * 50, bytes(range(256)) * 9])
def test_not_onnx(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(content)
    assert "not an ONNX model" in refusal(path)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_truncated(share: float, tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "model.onnx",
        {"heatmap": np.ones((1, 17, 32, 24), np.float32)},
        input_shape=[1, 3, 128, 96],
    )
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    assert "truncated" in refusal(path)


@pytest.mark.parametrize("domain", ["", "nobody.knows"])
def test_missing_operator(domain: str, tmp_path: Path) -> None:
    message = refusal(unknown_operator(tmp_path / "model.onnx", domain=domain))
    assert "operator" in message
    assert "Dance" in message


def test_external_data_present_and_absent(tmp_path: Path) -> None:
    path = with_external_data(tmp_path / "model.onnx")
    assert inspect_model(path).form == "heatmap"
    (tmp_path / "model.onnx.data").unlink()
    message = refusal(path)
    assert "separate file" in message
    assert "model.onnx.data" in message


def test_nan_from_a_model(tmp_path: Path) -> None:
    path = dividing(tmp_path / "model.onnx")
    (tmp_path / "model.toml").write_text("mean = [0, 0, 0]\nstd = [255, 255, 255]\n")
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    boxes = Boxes(np.array([[2.0, 3, 40, 60]]), np.array([0.9]))
    white = np.full((90, 70, 3), 255, np.uint8)
    assert np.isfinite(model.estimate(white, boxes).xy).all()
    lost = model.estimate(np.zeros_like(white), boxes)
    assert np.isnan(lost.xy).all() and (lost.confidence == 0).all()
    assert (model.answers.pictures, model.answers.lost) == (2, 1)
    (said,) = losses([model.answers], first_time_s=0.5)
    assert said.startswith("1 of 2 pictures are lost") and "simcc_x holds NaN" in said


def test_nan_for_every_picture_is_an_error_that_names_the_first_time(tmp_path: Path) -> None:
    path = dividing(tmp_path / "model.onnx")
    (tmp_path / "model.toml").write_text("mean = [0, 0, 0]\nstd = [255, 255, 255]\n")
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    for _ in range(3):
        model.estimate(
            np.zeros((90, 70, 3), np.uint8), Boxes(np.array([[2.0, 3, 40, 60]]), np.array([0.9]))
        )
    with pytest.raises(ModelError, match=r"holds NaN.* all 3 pictures .* from 0\.50 s on"):
        losses([model.answers], first_time_s=0.5)


@pytest.mark.parametrize("shape", [[1, 3, 1_000_000, 1_000_000], [1, 3, 20_000, 20_000]])
def test_sizes_beyond_memory_are_refused_before_anything_is_allocated(
    shape: list[int], tmp_path: Path
) -> None:
    path = emitting(
        tmp_path / "model.onnx",
        {"dets": np.zeros((1, 2, 5), np.float32), "labels": np.zeros((1, 2), np.int64)},
        input_shape=shape,
    )
    assert "GiB" in refusal(path)


def test_a_picture_larger_than_any_model_takes(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "model.onnx",
        {"dets": np.zeros((1, 2, 5), np.float32), "labels": np.zeros((1, 2), np.int64)},
        input_shape=[1, 3, 5000, 5000],
    )
    assert "5000" in refusal(path)


def test_memory_that_cannot_be_had_while_running(tmp_path: Path) -> None:
    path = allocating(tmp_path / "model.onnx", gibibytes=1_000_000)
    with pytest.raises(ModelError, match=r"model\.onnx: the model failed: .* more memory than"):
        load_detector(path)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ([1, 1, 64, 48], "grey"),
        ([1, 7, 64, 48], "no axis of 3"),
        ([1, 3, 64], "inputs seen"),
    ],
)
def test_inputs_that_are_no_picture(shape: list[int], said: str, tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "model.onnx", {"x": np.zeros((1, 2, 5), np.float32)}, input_shape=shape
    )
    assert said in refusal(path)


def test_names_of_weights_are_found_in_the_file(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "model.onnx",
        {"head.rtm_cls.0": np.zeros((1, 2, 5), np.float32)},
        input_shape=[1, 3, 64, 48],
    )
    session = open_session(path, threads=1)
    assert session.mentions("obj_preds", "rtm_cls") == "rtm_cls"
    assert session.mentions("obj_preds") is None


def test_read_only_model_in_a_folder_with_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "Tänzerin 舞 models"
    folder.mkdir()
    path = emitting(
        folder / "rtmdet ü.onnx",
        {"dets": np.zeros((1, 2, 5), np.float32), "labels": np.zeros((1, 2), np.int64)},
        input_shape=[1, 3, 64, 96],
    )
    path.chmod(0o444)
    assert len(load_detector(path).detect(np.zeros((50, 70, 3), np.uint8))) == 0
