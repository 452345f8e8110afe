"""Which hardware runs a model: chosen from what is offered, and never changed in silence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from dance2pose.errors import UsageError
from dance2pose.onnx_models.inference import open_session
from dance2pose.onnx_models.providers import CPU, KNOWN, choose_provider, what_ran
from dance2pose.options import SpeedOptions
from dance2pose.people import PoseModels
from onnx_graphs import emitting

CUDA, TENSORRT = "CUDAExecutionProvider", "TensorrtExecutionProvider"


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_offered_is_taken_with_the_processor_as_the_last(name: str) -> None:
    choice = choose_provider(name, [provider for provider, _ in KNOWN.values()])
    assert choice.providers[0] == KNOWN[name][0]
    assert choice.providers[-1] == CPU
    assert choice.note is None


@pytest.mark.parametrize("name", [name for name in KNOWN if name != "cpu"])
def test_what_is_not_offered_is_told_with_the_package_that_has_it(name: str) -> None:
    choice = choose_provider(name, [CPU])
    assert choice.providers == (CPU,)
    assert choice.note is not None
    assert name in choice.note
    assert KNOWN[name][1] in choice.note


@pytest.mark.parametrize(
    ("offered", "taken"),
    [
        ([CPU], "cpu"),
        ([TENSORRT, CUDA, CPU], "cuda"),
        (["DmlExecutionProvider", CPU], "directml"),
        (["CoreMLExecutionProvider", CPU], "coreml"),
        (["OpenVINOExecutionProvider", CPU], "cpu"),
    ],
)
def test_auto_takes_the_fastest_that_is_offered(offered: list[str], taken: str) -> None:
    choice = choose_provider("auto", offered)
    assert choice.wanted == taken
    assert choice.note is None


def test_what_is_offered_and_does_not_come_up_is_told() -> None:
    choice = choose_provider("cuda", [CUDA, CPU])
    assert what_ran(choice, [CUDA, CPU]) is None
    said = what_ran(choice, [CPU])
    assert said is not None
    assert "did not come up" in said


def test_names_that_are_not_known_are_refused() -> None:
    with pytest.raises(UsageError, match="expected auto"):
        choose_provider("gpu", [CPU])
    with pytest.raises(UsageError, match="cuda"):
        SpeedOptions(provider="cudo")  # type: ignore[arg-type]


@pytest.mark.parametrize("fails", [False, True])
def test_a_session_says_what_really_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    """A stand-in list: this machine offers CUDA, which then refuses to start or is left out."""
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: [CUDA, CPU])
    real = onnxruntime.InferenceSession

    def made(path: str, *, sess_options: Any, providers: list[str]) -> Any:
        if CUDA in providers and fails:
            raise RuntimeError("no driver")
        return real(path, sess_options=sess_options, providers=[CPU])

    monkeypatch.setattr(onnxruntime, "InferenceSession", made)
    model = emitting(tmp_path / "m.onnx", {"a": np.zeros((1, 3), np.float32)}, input_shape=(1, 3))
    session = open_session(model, provider="cuda")
    assert session.runs_with == CPU
    assert session.note is not None
    assert "did not come up" in session.note
    assert open_session(model).note is None


def test_models_tell_what_runs_them_once(tmp_path: Path) -> None:
    from dance2pose.detection import load_detector
    from dance2pose.keypoints import load_pose_model
    from onnx_graphs import heatmaps_of_colours

    values = {"dets": np.zeros((1, 2, 5), np.float32), "labels": np.zeros((1, 2), np.int64)}
    detector = emitting(tmp_path / "det.onnx", values, input_shape=(1, 3, 96, 96))
    pose = heatmaps_of_colours(tmp_path / "pose.onnx", width=48, height=64)
    models = PoseModels(
        load_detector(detector, provider="directml"), load_pose_model(pose, provider="directml")
    )
    assert models.hardware == {"detector runs with": CPU, "keypoint model runs with": CPU}
    assert len(models.notes) == 1
    assert "onnxruntime-directml" in models.notes[0]
