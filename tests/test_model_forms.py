"""Recognition never takes one family for another: what is no score, box or class is refused."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.detection import load_detector
from dance2pose.errors import ModelError
from dance2pose.keypoints import OneStageEstimator, load_pose_model
from dance2pose.onnx_models.recognition import inspect_model
from onnx_graphs import emitting

Array = npt.NDArray[Any]

WIDTH, HEIGHT = 96, 64
CELLS = 12 * 8 + 6 * 4 + 3 * 2
IMAGE = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
INPUT = [1, 3, HEIGHT, WIDTH]


def emit(path: Path, **outputs: Array) -> Path:
    floats = {n: v.astype(np.float32) if v.dtype.kind == "f" else v for n, v in outputs.items()}
    return emitting(path, floats, input_shape=INPUT)


@pytest.mark.parametrize(
    "outputs",
    [
        # YOLOv8 without its last sigmoid; YOLOX with logits; rows whose "class" is a fraction.
        {"columns": np.linspace(-9, 9, 84 * CELLS).reshape(1, 84, CELLS)},
        {"rows": np.linspace(-9, 9, 85 * CELLS).reshape(1, CELLS, 85)},
        {"rows": np.linspace(0.1, 60, 6 * 50).reshape(1, 50, 6)},
        # Turned boxes: centre, size, angle.
        {"dets": np.full((1, 7, 5), 2.5), "labels": np.zeros((1, 7), np.int64)},
        # Two outputs that share a length but hold no scores.
        {"boxes": np.ones((7, 4)), "labels": np.zeros(7, np.int64), "areas": np.full(7, 900.0)},
        {"rows": np.concatenate([np.full((5, 6), 3.7), np.full((5, 1), 0.5)], axis=1)},
    ],
)
def test_values_that_contradict_a_form_are_refused_with_what_they_span(
    outputs: dict[str, Array], tmp_path: Path
) -> None:
    with pytest.raises(ModelError, match=r"not recognised .* on grey\)") as refused:
        inspect_model(emit(tmp_path / "m.onnx", **outputs))
    assert "\n" not in str(refused.value)


def test_a_form_that_the_manifest_states_is_believed(tmp_path: Path) -> None:
    rows = np.concatenate([np.full((5, 4), 30.0), [[0.9, 0.5]] * 5], axis=1)[None]
    path = emit(tmp_path / "m.onnx", rows=rows)
    with pytest.raises(ModelError, match="not recognised"):
        inspect_model(path)
    (tmp_path / "m.toml").write_text('form = "rows-xyxy-score-class"\n')
    detector = load_detector(path)
    with pytest.raises(ModelError, match=r"was read as rows-xyxy-score-class, but .* not whole"):
        detector.detect(IMAGE)


def test_scores_that_are_none_are_refused_when_they_come(tmp_path: Path) -> None:
    dets = np.array([[[5, 5, 40, 60, 87.0]]])
    (tmp_path / "m.toml").write_text('form = "dets-labels"\n')
    path = emit(tmp_path / "m.onnx", dets=dets, labels=np.zeros((1, 1), np.int64))
    with pytest.raises(ModelError, match="but gives 87 as a score, which lies in 0 to 1"):
        load_detector(path).detect(IMAGE)


def test_a_pose_model_needs_scores_for_its_keypoints(tmp_path: Path) -> None:
    """[1, 56, cells] with 52 classes or 17 keypoints: here every value is a score, or is not."""
    columns = np.full((1, 56, CELLS), 30.0)
    columns[:, 4] = 0.2
    with pytest.raises(ModelError, match="not recognised"):
        inspect_model(emit(tmp_path / "a.onnx", columns=columns))
    columns[:, 7::3] = 0.9
    assert inspect_model(emit(tmp_path / "b.onnx", columns=columns)).form == "yolov8-pose"


def people(score: float) -> dict[str, Array]:
    dets = np.array([[[5, 5, 40, 60, score], [1, 1, 9, 9, 0.01]]])
    return {"dets": dets, "labels": np.zeros((1, 2), np.int64)}


def test_the_reading_names_form_class_threshold_and_best_score(tmp_path: Path) -> None:
    detector = load_detector(emit(tmp_path / "m.onnx", **people(0.21)))
    assert "best score" not in detector.describe_reading()
    assert len(detector.detect(IMAGE)) == 0
    said = detector.describe_reading()
    for part in ("m.onnx: was read as dets-labels", "class 0", "is 0.21", "from 0.3 on"):
        assert part in said
    assert "\n" not in said


def test_the_threshold_can_be_set(tmp_path: Path) -> None:
    path = emit(tmp_path / "m.onnx", **people(0.21))
    detector = load_detector(path, min_confidence=0.2)
    assert len(detector.detect(IMAGE)) == 1
    assert "from 0.2 on" in detector.describe_reading()


def test_the_best_score_of_columns_that_are_cut_before_they_are_read(tmp_path: Path) -> None:
    for name, columns in (("yolov8", np.zeros((1, 9, CELLS))), ("pose", np.zeros((1, 56, CELLS)))):
        columns[0, 4, 11] = 0.17
        path = emit(tmp_path / f"{name}.onnx", columns=columns)
        model = load_detector(path) if name == "yolov8" else load_pose_model(path)
        if isinstance(model, OneStageEstimator):
            model.find(IMAGE)
        else:
            model.detect(IMAGE)
        assert "is 0.17" in model.describe_reading()


def test_infinite_boxes_lose_the_picture(tmp_path: Path) -> None:
    dets = np.array([[[np.inf, 5, 40, 60, 0.9], [1, 1, 9, 9, 0.01]]])
    detector = load_detector(
        emit(tmp_path / "m.onnx", dets=dets, labels=np.zeros((1, 2), np.int64))
    )
    assert len(detector.detect(IMAGE)) == 0
    assert (detector.answers.pictures, detector.answers.lost) == (1, 1)


@pytest.mark.parametrize("batched", [False, True])
@pytest.mark.parametrize("order", [("box", "score", "label"), ("box", "label", "score")])
def test_a_score_of_one_is_not_taken_for_a_class(
    tmp_path: Path, order: tuple[str, ...], batched: bool
) -> None:
    parts = {"box": [3.0, 4.0, 21.0, 33.0], "score": [1.0], "label": [0.0]}
    rows = np.concatenate([parts[name] for name in order])[None]
    boxes = load_detector(emit(tmp_path / "m.onnx", rows=rows[None] if batched else rows)).detect(
        IMAGE
    )
    np.testing.assert_allclose(boxes.confidence, [1.0])


@given(
    order=st.sampled_from(list(itertools.permutations(["box", "score", "label"]))),
    batched=st.booleans(),
    scores=st.lists(st.floats(0.5, 1), min_size=1, max_size=4),
    others=st.lists(st.floats(0.5, 1), max_size=3),
    seed=st.integers(0, 2**16),
)
@settings(max_examples=40, deadline=None)
def test_rows_in_any_order_give_the_planted_people_or_are_refused(
    order: tuple[str, ...], batched: bool, scores: list[float], others: list[float], seed: int
) -> None:
    random = np.random.default_rng(seed)
    count = len(scores) + len(others)
    corner = random.uniform(0, 30, (count, 2)) + 0.25
    parts = {
        "box": np.concatenate([corner, corner + random.uniform(5, 30, (count, 2))], axis=1),
        "score": np.array([*scores, *others])[:, None],
        # Other classes, the highest of which tells COCO's numbers from scores.
        "label": np.array([0.0] * len(scores) + [7.0] * len(others))[:, None],
    }
    rows = np.concatenate([parts[name] for name in order], axis=1)
    with TemporaryDirectory() as folder:
        path = emit(Path(folder) / "m.onnx", rows=rows[None] if batched else rows)
        try:
            boxes = load_detector(path).detect(IMAGE)
        except ModelError as refused:
            assert "m.onnx" in str(refused)
            assert order not in PUBLISHED
            return
    np.testing.assert_allclose(boxes.confidence, np.sort(scores)[::-1], atol=1e-6)


PUBLISHED = {("box", "score", "label"), ("box", "label", "score"), ("label", "score", "box")}


@st.composite
def outputs(draw: st.DrawFn) -> dict[str, Array]:
    """One to three outputs of shapes and values near those of real detectors."""
    length = st.sampled_from([1, 4, 5, 6, 7, 9, 56, 84, 85, CELLS, 3 * CELLS])
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    made = {}
    for number in range(draw(st.integers(1, 3))):
        shape = draw(st.lists(length, min_size=1, max_size=2))
        shape = [1, *shape] if draw(st.booleans()) else shape
        low, high = draw(st.sampled_from([(0, 0), (0, 1), (0, 90), (-9, 9), (0, 1e30), (5, 5)]))
        values = random.uniform(low, high, shape)
        made[f"o{number}"] = (
            values.astype(np.int64) if high < 100 and draw(st.booleans()) else values
        )
    return made


@given(outputs())
@settings(max_examples=80, deadline=None)
def test_whatever_a_model_gives_is_refused_or_read_as_boxes_with_scores(
    made: dict[str, Array],
) -> None:
    with TemporaryDirectory() as folder:
        path = emit(Path(folder) / "m.onnx", **made)
        try:
            detector = load_detector(path)
            boxes = detector.detect(IMAGE)
        except ModelError as refused:
            assert "m.onnx" in str(refused) and "\n" not in str(refused)
            return
    assert ((boxes.confidence >= 0) & (boxes.confidence <= 1)).all()
    assert np.isfinite(boxes.xyxy).all()
    assert (boxes.xyxy[:, 2:] >= boxes.xyxy[:, :2]).all()


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("xyxy_score_label", "cells-xyxy-score-class"),
        ("logits_fractional_boxes", "queries"),
        ("person_is_class_1", "boxes-scores-classes"),
    ],
)
def test_detectors_of_other_families_find_the_planted_person(
    name: str, form: str, shared: Path
) -> None:
    detector = load_detector(shared / "cases" / f"detector_{name}.onnx")
    assert detector.description.form == form
    planted = json.loads((shared / "cases" / "detector_planted_box.json").read_text())
    boxes = detector.detect(np.zeros((496, 384, 3), np.uint8))
    assert len(boxes) == 1 and boxes.confidence[0] > 0.8
    np.testing.assert_allclose(boxes.xyxy[0], planted, atol=1)
