"""Recognition: what is said of a model, and what is refused with what was seen and is known."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dance2pose.detection import load_detector
from dance2pose.errors import ModelError
from dance2pose.onnx_models.recognition import FORMS, inspect_model
from onnx_graphs import emitting


def rtmdet(path: Path, **about: object) -> Path:
    return emitting(
        path,
        {"dets": np.zeros((1, 3, 5), np.float32), "labels": np.zeros((1, 3), np.int64)},
        input_shape=[1, 3, "height", "width"],
        **about,  # type: ignore[arg-type]
    )


def test_unknown_outputs_are_listed_with_the_forms_that_are_known(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "segmentation.onnx",
        {"masks": np.zeros((1, 4, 9, 7, 2), np.float32)},
        input_shape=[1, 3, 64, 96],
    )
    with pytest.raises(ModelError) as refused:
        inspect_model(path)
    message = str(refused.value)
    assert "masks [1, 4, 9, 7, 2] float32" in message
    assert "96x64" in message
    assert all(f"{name} (" in message for name in FORMS)


def test_a_number_of_keypoints_that_no_skeleton_has(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "hand.onnx",
        {"x": np.zeros((1, 21, 96), np.float32), "y": np.zeros((1, 21, 128), np.float32)},
        input_shape=[1, 3, 64, 48],
    )
    with pytest.raises(ModelError, match=r"gives 21 keypoints; skeletons known: mpii16 .16."):
        inspect_model(path)


def test_description(tmp_path: Path) -> None:
    path = rtmdet(tmp_path / "rtmdet.onnx")
    description = inspect_model(path)
    assert description.path == path
    assert description.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert description.size_bytes == path.stat().st_size
    assert (description.kind, description.form) == ("detector", "dets-labels")
    assert (description.manifest.input_width, description.manifest.input_height) == (320, 320)
    assert any("NMS inside" in reason for reason in description.reasons)
    assert any("file name" in line for line in description.assumed)


def test_rtmdet_and_yolox_of_the_same_form_get_their_own_normalisation(tmp_path: Path) -> None:
    assert inspect_model(rtmdet(tmp_path / "rtmdet_m.onnx")).manifest.mean != (0, 0, 0)
    assert inspect_model(rtmdet(tmp_path / "yolox_m.onnx")).manifest.mean == (0, 0, 0)
    named = rtmdet(tmp_path / "model.onnx", metadata={"note": "head.obj_preds.0.weight"})
    description = inspect_model(named)
    assert description.manifest.mean == (0, 0, 0)
    assert any("weights named obj_preds" in line for line in description.assumed)
    nothing = inspect_model(rtmdet(tmp_path / "end2end.onnx"))
    assert any("nothing in the file tells" in line for line in nothing.assumed)


def test_the_manifest_beside_the_model_wins(tmp_path: Path) -> None:
    path = rtmdet(tmp_path / "m.onnx")
    (tmp_path / "m.toml").write_text("input_width = 640\ninput_height = 480\nmean = [1, 2, 3]\n")
    description = inspect_model(path)
    manifest = description.manifest
    assert (manifest.input_width, manifest.input_height, manifest.mean) == (640, 480, (1, 2, 3))
    assert description.manifest_file == tmp_path / "m.toml"


def test_a_manifest_named_in_place_of_the_model(tmp_path: Path) -> None:
    rtmdet(tmp_path / "m.onnx")
    (tmp_path / "m.toml").write_text("score_threshold = 0.6\n")
    (tmp_path / "strict.toml").write_text('model = "m.onnx"\nscore_threshold = 0.9\n')
    assert load_detector(tmp_path / "m.toml").description.manifest.score_threshold == 0.6
    assert load_detector(tmp_path / "strict.toml").description.manifest.score_threshold == 0.9
    (tmp_path / "lost.toml").write_text('model = "gone.onnx"\n')
    with pytest.raises(ModelError, match=r"lost\.toml: its model .*gone\.onnx: no such file"):
        load_detector(tmp_path / "lost.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('form = "dets"', "unknown form 'dets'; known: rtmo"),
        ('form = "yolov8"', "not recognised as a model of form yolov8. Outputs seen: dets"),
        ('kind = "pose"', "not recognised as a model of kind pose"),
        ('skeleton = "coco17"', "skeleton has no meaning for a model of kind 'detector'"),
        ("nms_threshold = 0.5", "nms_threshold has no meaning for the output form 'dets-labels'"),
        ('resize = "crop"', "does not fit a model of kind 'detector'"),
    ],
)
def test_a_manifest_that_does_not_fit_its_model(text: str, said: str, tmp_path: Path) -> None:
    path = rtmdet(tmp_path / "m.onnx")
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(ModelError) as refused:
        inspect_model(path)
    assert said in str(refused.value)


def test_sizes_and_classes_that_contradict_the_graph(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "m.onnx",
        {"boxes": np.zeros((1, 99, 4), np.float32), "scores": np.zeros((1, 5, 99), np.float32)},
        input_shape=[1, 3, 64, 96],
    )
    (tmp_path / "m.toml").write_text("person_class = 5\n")
    with pytest.raises(ModelError, match=r"tells 5 classes apart.*number 5"):
        inspect_model(path)
    (tmp_path / "m.toml").write_text("input_width = 64\ninput_height = 96\n")
    with pytest.raises(ModelError, match="takes pictures of 96x64 px, but its manifest says 64x96"):
        inspect_model(path)


def test_fifty_two_classes_or_seventeen_keypoints(tmp_path: Path) -> None:
    """[1, 56, cells] is both; Ultralytics' metadata decide, and without them it is the pose."""
    cells = 32 * 20 + 16 * 10 + 8 * 5

    def graph(metadata: dict[str, str]) -> Path:
        return emitting(
            tmp_path / "m.onnx",
            {"output0": np.zeros((1, 56, cells), np.float32)},
            input_shape=[1, 3, 160, 256],
            metadata=metadata,
        )

    assert inspect_model(graph({})).form == "yolov8-pose"
    assert inspect_model(graph({"task": "pose", "kpt_shape": "[17, 3]"})).form == "yolov8-pose"
    assert inspect_model(graph({"task": "detect"})).form == "yolov8"


def test_inspect_on_the_command_line(tmp_path: Path) -> None:
    path = rtmdet(tmp_path / "rtmdet.onnx")

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "dance2pose", "models", "inspect", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    result = run(str(path), "--write")
    assert result.returncode == 0, result.stderr
    for said in ("detector model, output form dets-labels", "NMS inside", "Assumed, check it:"):
        assert said in result.stdout
    before = inspect_model(path)
    assert before.manifest_file == tmp_path / "rtmdet.toml"
    again = run(str(path), "--write")
    assert (again.returncode, "exists already" in again.stderr) == (2, True)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    assert run(str(path), "-o", str(elsewhere / "mine.toml")).returncode == 0
    moved = inspect_model(elsewhere / "mine.toml")
    assert moved.path == path
    assert moved.manifest.mean == before.manifest.mean
    (tmp_path / "not.onnx").write_text("hello")
    refused = run(str(tmp_path / "not.onnx"))
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == 1
    assert "Traceback" not in refused.stderr
