"""Detectors: each output form, fed with boxes planted in the picture, gives those boxes back.

The planted boxes are taken into the network's input by formulas written here, not by the
package's own, and into each published form by an encoder written here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from dance2pose.detection import Detector, load_detector
from dance2pose.errors import ModelError
from dance2pose.onnx_models.recognition import FORMS
from onnx_graphs import emitting

Array = npt.NDArray[Any]

# The picture is 384 x 320, the network's input 256 x 160: letterboxed to 192 x 160.
PICTURE = (384, 320)
WIDTH, HEIGHT = 256, 160
CELLS = 32 * 20 + 16 * 10 + 8 * 5
IMAGE = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)

# Three people, in pixel-edge coordinates of the picture, and their scores.
PEOPLE = np.array([[30, 40, 130, 290], [200, 20, 280, 260], [300, 100, 370, 310]], np.float32)
SCORES = np.array([0.6, 0.9, 0.75], np.float32)


def letterboxed(centre: bool) -> Array:
    left = (WIDTH - 192) / 2 if centre else 0
    return PEOPLE * 0.5 + np.array([left, 0, left, 0], np.float32)


def stretched() -> Array:
    sx, sy = WIDTH / PICTURE[0], HEIGHT / PICTURE[1]
    return PEOPLE * np.array([sx, sy, sx, sy], np.float32)


def centre_and_size(boxes: Array) -> Array:
    return np.concatenate(
        [(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]], axis=1
    ).astype(np.float32)


def rows_at(values: Array, count: int, columns: int) -> Array:
    """Zero rows but for `values`, spread over them."""
    rows = np.zeros((count, columns), np.float32)
    rows[spread(len(values), count)] = values
    return rows


def spread(number: int, count: int) -> Array:
    return np.array([1, 5, 9, 3, 7, 11])[:number] * (count // 12)


def with_class(scores: Array, classes: int, person: int) -> Array:
    """Scores of all classes, in which another class is surer elsewhere and the person's is kept."""
    out = np.full((len(scores), classes), 0.01, np.float32)
    out[:, person] = scores
    return out


def yolox(path: Path) -> Path:
    boxes = centre_and_size(letterboxed(centre=False))
    grid = []
    for stride in (8, 16, 32):
        for y in range(HEIGHT // stride):
            grid += [(x, y, stride) for x in range(WIDTH // stride)]
    cells = np.array(grid, np.float32)
    rows = np.zeros((CELLS, 85), np.float32)
    # One cell of each stride, and the first box a second time, from another cell: NMS removes it.
    for box, score, i in zip(boxes[[0, 1, 2, 0]], [*SCORES, 0.5], [37, 655, 810, 700], strict=True):
        x, y, stride = cells[i]
        rows[i, :2] = box[:2] / stride - (x, y)
        rows[i, 2:4] = np.log(box[2:] / stride)
        rows[i, 4] = 0.95
        rows[i, 5] = score / 0.95
    rows[20, 4:] = [0.99, 0.0, *[0.9] * 79]  # a sure dog
    return emitting(path, {"output": rows[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def objectness_rows(boxes: Array, classes: int) -> Array:
    values = np.concatenate(
        [
            centre_and_size(boxes),
            np.full((len(boxes), 1), 0.95, np.float32),
            with_class(SCORES / np.float32(0.95), classes, 0),
        ],
        axis=1,
    )
    return np.concatenate([values, values[:1] * np.float32(0.98)])


def yolov5(path: Path) -> Path:
    rows = rows_at(objectness_rows(letterboxed(centre=True), 80), 3 * CELLS, 85)
    return emitting(
        path,
        {"output0": rows[None]},
        input_shape=[1, 3, HEIGHT, WIDTH],
        metadata={"names": "{0: 'person', 1: 'bicycle'}", "task": "detect"},
    )


def yolox_decoded(path: Path) -> Path:
    rows = rows_at(objectness_rows(letterboxed(centre=False), 1), CELLS, 6)
    return emitting(path, {"output": rows[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def yolov8(path: Path) -> Path:
    boxes = letterboxed(centre=True)
    values = np.concatenate([centre_and_size(boxes), with_class(SCORES, 5, 3)], axis=1)
    values = np.concatenate([values, values[1:2]])  # the surest twice
    columns = rows_at(values, CELLS, 9).T
    return emitting(
        path,
        {"output0": columns[None]},
        input_shape=[1, 3, HEIGHT, WIDTH],
        input_name="images",
        metadata={"names": "{0: 'cat', 3: 'person'}"},
    )


def rtmdet(path: Path) -> Path:
    dets = np.concatenate([letterboxed(centre=False), SCORES[:, None]], axis=1)
    dog = np.array([[0, 0, 50, 50, 0.99]], np.float32)
    return emitting(
        path,
        {
            "dets": np.concatenate([dog, dets])[None],
            "labels": np.array([[16, 0, 0, 0]], np.int64),
        },
        input_shape=["batch", 3, HEIGHT, WIDTH],
        declared={"dets": ["batch", "n", "five"], "labels": ["batch", "n"]},
    )


def picodet(path: Path) -> Path:
    boxes = rows_at(stretched(), 850, 4)
    scores = np.zeros((1, 2, 850), np.float32)
    scores[0, 0, spread(3, 850)] = SCORES
    scores[0, 1, 7] = 0.99
    return emitting(path, {"a": boxes[None], "b": scores}, input_shape=[1, 3, HEIGHT, WIDTH])


def paddle_rows(path: Path) -> Path:
    rows = np.concatenate([np.zeros((3, 1), np.float32), SCORES[:, None], stretched()], axis=1)
    bottle = np.array([[39, 0.99, 0, 0, 20, 20], [-1, 0, 0, 0, 0, 0]], np.float32)
    return emitting(
        path,
        {"boxes": np.concatenate([rows, bottle]), "count": np.array([5], np.int32)},
        input_shape=[1, 3, HEIGHT, WIDTH],
        input_name="image",
        declared={"boxes": ["n", 6], "count": ["batch"]},
        extra_inputs={
            "scale_factor": (np.float32, [1, 2]),
            "im_shape": (np.float32, [1, 2]),
        },
    )


def nms_rows(path: Path) -> Path:
    rows = np.zeros((300, 6), np.float32)
    rows[:3] = np.concatenate(
        [letterboxed(centre=True), SCORES[:, None], np.zeros((3, 1), np.float32)], axis=1
    )
    rows[3] = [5, 5, 50, 50, 0.95, 2]
    return emitting(path, {"output0": rows[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def yolov7_rows(path: Path) -> Path:
    zero = np.zeros((3, 1), np.float32)
    rows = np.concatenate([zero, letterboxed(centre=True), zero, SCORES[:, None]], axis=1)
    car = np.array([[0, 5, 5, 90, 90, 2, 0.99]], np.float32)
    return emitting(
        path,
        {"output": np.concatenate([car, rows]).astype(np.float32)},
        input_shape=[1, 3, HEIGHT, WIDTH],
        declared={"output": ["n", 7]},
    )


def rows_with_class_before_score(path: Path) -> Path:
    rows = np.concatenate([letterboxed(centre=True), np.zeros((3, 1)), SCORES[:, None]], axis=1)
    cat = np.array([[5, 5, 50, 50, 15, 0.95]])
    return emitting(
        path,
        {"output0": np.concatenate([cat, rows]).astype(np.float32)[None]},
        input_shape=[1, 3, HEIGHT, WIDTH],
    )


def rows_without_batch(path: Path) -> Path:
    rows = np.concatenate([letterboxed(centre=True), SCORES[:, None], np.zeros((3, 1))], axis=1)
    return emitting(path, {"out": rows.astype(np.float32)}, input_shape=[1, 3, HEIGHT, WIDTH])


def surest_class_of_each_cell(path: Path) -> Path:
    """As `detector_xyxy_score_label`: no NMS, and most rows hold a box in no order."""
    random = np.random.default_rng(3)
    rows = random.uniform(0, WIDTH, (CELLS, 6)).astype(np.float32)
    rows[:, 4] = 1e-5
    rows[:, 5] = random.integers(0, 80, CELLS)
    people = np.concatenate([letterboxed(centre=True), SCORES[:, None], np.zeros((3, 1))], axis=1)
    rows[spread(3, CELLS)] = people
    rows[2, :] = people[1] - [0, 0, 0, 0, 0.1, 0]  # the surest a second time: NMS removes it
    rows[40] = [60, 60, 120, 120, 0.99, 56]  # a chair
    return emitting(path, {"output": rows[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def yolov8_transposed(path: Path) -> Path:
    values = np.concatenate(
        [centre_and_size(letterboxed(centre=True)), with_class(SCORES, 80, 0)], axis=1
    )
    rows = rows_at(np.concatenate([values, values[1:2]]), CELLS, 84)
    return emitting(path, {"output0": rows[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def yolov8_in_fractions(path: Path) -> Path:
    boxes = centre_and_size(letterboxed(centre=True)) / [WIDTH, HEIGHT, WIDTH, HEIGHT]
    values = np.concatenate([boxes, with_class(SCORES, 80, 0)], axis=1)
    columns = rows_at(values.astype(np.float32), CELLS, 84).T
    return emitting(path, {"output0": columns[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def logit(scores: Array) -> Array:
    return np.log(scores / (1 - scores))


def queries(path: Path, classes: int, person: int, *, nothing: bool = False) -> Path:
    """A head of the DETR family: logits of `classes`, boxes as centre and size in fractions."""
    values = np.full((100, classes), -5.0)
    boxes = np.tile([0.5, 0.5, 0.1, 0.1], (100, 1))
    where = np.array([4, 50, 99])
    boxes[where] = centre_and_size(PEOPLE / np.array([*PICTURE, *PICTURE], np.float32))
    values[where, person] = logit(SCORES)
    if nothing:  # softmax over the classes and "nothing", the last
        values[:, -1] = 5
        values[where] = -50
        values[where, person], values[where, -1] = np.log(SCORES), np.log(1 - SCORES)
    return emitting(
        path,
        {"logits": values.astype(np.float32)[None], "pred_boxes": boxes.astype(np.float32)[None]},
        input_shape=[1, 3, HEIGHT, WIDTH],
    )


def yolo_nas(path: Path) -> Path:
    boxes = rows_at(letterboxed(centre=True), CELLS, 4)
    scores = np.full((1, CELLS, 80), 0.01, np.float32)
    scores[0, spread(3, CELLS), 0] = SCORES
    return emitting(path, {"boxes": boxes[None], "s": scores}, input_shape=[1, 3, HEIGHT, WIDTH])


def torchvision(path: Path) -> Path:
    return emitting(
        path,
        {
            "boxes": np.concatenate([letterboxed(centre=True), [[9, 9, 99, 99]]]).astype(
                np.float32
            ),
            "labels": np.array([1, 1, 1, 62], np.int64),
            "scores": np.array([*SCORES, 0.99], np.float32),
        },
        input_shape=[1, 3, HEIGHT, WIDTH],
        declared={"boxes": ["n", 4], "labels": ["n"], "scores": ["n"]},
    )


def rt_detr(path: Path) -> Path:
    rows = np.concatenate([stretched(), np.array([[9, 9, 99, 99]], np.float32)])
    return emitting(
        path,
        {
            "labels": np.array([[0, 0, 0, 4]], np.int64),
            "boxes": rows[None],
            "scores": np.array([[*SCORES, 0.99]], np.float32),
        },
        input_shape=["N", 3, HEIGHT, WIDTH],
        input_name="images",
        extra_inputs={"orig_target_sizes": (np.int64, ["N", 2])},
    )


def tensorflow(path: Path) -> Path:
    fractions = (PEOPLE / np.array([*PICTURE, *PICTURE], np.float32))[:, [1, 0, 3, 2]]
    return emitting(
        path,
        {
            "detection_boxes": fractions[None],
            "detection_classes": np.array([[1, 1, 1]], np.float32),
            "detection_scores": SCORES[None],
            "num_detections": np.array([3], np.float32),
        },
        input_shape=[1, HEIGHT, WIDTH, 3],
        input_dtype=np.uint8,
    )


BUILDERS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "yolox": (yolox, "yolox"),
    "yolox decoded inside": (yolox_decoded, "yolov5"),
    "yolov5": (yolov5, "yolov5"),
    "yolov8 and 11": (yolov8, "yolov8"),
    "rtmdet": (rtmdet, "dets-labels"),
    "picodet": (picodet, "boxes-scores"),
    "paddle with nms": (paddle_rows, "rows-class-score-xyxy"),
    "yolov10": (nms_rows, "rows-xyxy-score-class"),
    "yolov7 end to end": (yolov7_rows, "rows-batch-xyxy-class-score"),
    "rt-detr": (rt_detr, "boxes-scores-classes"),
    "tensorflow": (tensorflow, "boxes-scores-classes"),
    "torchvision": (torchvision, "boxes-scores-classes"),
    "rows, class before score": (rows_with_class_before_score, "rows-xyxy-class-score"),
    "rows, no batch": (rows_without_batch, "rows-xyxy-score-class"),
    "surest class of each cell": (surest_class_of_each_cell, "cells-xyxy-score-class"),
    "yolov8 transposed": (yolov8_transposed, "yolov8"),
    "yolov8 in fractions": (yolov8_in_fractions, "yolov8"),
    "yolo-nas": (yolo_nas, "boxes-scores"),
    "rt-detr head": (lambda path: queries(path, 80, 0), "queries"),
    "deformable detr head": (lambda path: queries(path, 91, 1), "queries"),
    "detr head": (lambda path: queries(path, 92, 1, nothing=True), "queries"),
    "detr head of one class": (lambda path: queries(path, 2, 0, nothing=True), "queries"),
}


@pytest.mark.parametrize("family", BUILDERS)
def test_planted_people_come_back(family: str, tmp_path: Path) -> None:
    build, form = BUILDERS[family]
    detector = load_detector(build(tmp_path / "m.onnx"))
    assert detector.description.form == form
    assert isinstance(detector, Detector)
    boxes = detector.detect(IMAGE)
    order = np.argsort(-SCORES)
    # Boxes are measured between pixel edges in detectors, from pixel centres in the project.
    np.testing.assert_allclose(boxes.xyxy, PEOPLE[order] - 0.5, atol=2e-3)
    np.testing.assert_allclose(boxes.confidence, SCORES[order], atol=1e-6)


def test_every_detector_form_has_a_graph() -> None:
    tested = {form for _, form in BUILDERS.values()}
    assert tested == {form.name for form in FORMS.values() if form.kind == "detector"}


def test_score_threshold_of_the_manifest(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text("score_threshold = 0.7\n")
    boxes = load_detector(rtmdet(tmp_path / "m.onnx")).detect(IMAGE)
    np.testing.assert_allclose(boxes.confidence, [0.9, 0.75])


def test_boxes_are_cut_at_the_border_and_those_outside_dropped(tmp_path: Path) -> None:
    dets = np.array(
        [[-20, -9, 60, 80, 0.9], [-50, 5, -2, 60, 0.8], [180, 20, 240, 200, 0.7]], np.float32
    )
    path = emitting(
        tmp_path / "m.onnx",
        {"dets": dets[None], "labels": np.zeros((1, 3), np.int64)},
        input_shape=[1, 3, HEIGHT, WIDTH],
    )
    boxes = load_detector(path).detect(IMAGE)
    expected = [[-0.5, -0.5, 119.5, 159.5], [359.5, 39.5, 383.5, 319.5]]
    np.testing.assert_allclose(boxes.xyxy, expected, atol=1e-4)


def test_nobody_is_an_empty_result(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "m.onnx",
        {"dets": np.zeros((1, 0, 5), np.float32), "labels": np.zeros((1, 0), np.int64)},
        input_shape=[1, 3, HEIGHT, WIDTH],
        declared={"dets": [1, "n", 5], "labels": [1, "n"]},
    )
    boxes = load_detector(path).detect(IMAGE)
    assert len(boxes) == 0
    assert boxes.xyxy.shape == (0, 4)


def test_scores_above_one_are_clipped(tmp_path: Path) -> None:
    dets = np.array([[[10, 10, 60, 80, 1.04]]], np.float32)
    path = emitting(
        tmp_path / "m.onnx",
        {"dets": dets, "labels": np.zeros((1, 1), np.int64)},
        input_shape=[1, 3, HEIGHT, WIDTH],
    )
    assert load_detector(path).detect(IMAGE).confidence == [1.0]


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.uint8])
@pytest.mark.parametrize("batch", [1, 4])
@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
def test_layouts_types_and_fixed_batches(
    dtype: type, batch: int, layout: str, tmp_path: Path
) -> None:
    dets = np.concatenate([letterboxed(centre=False), SCORES[:, None]], axis=1)
    nowhere = np.zeros((batch - 1, 3, 5), np.float32)
    shape = [3, HEIGHT, WIDTH] if layout == "NCHW" else [HEIGHT, WIDTH, 3]
    path = emitting(
        tmp_path / "m.onnx",
        {"dets": np.concatenate([dets[None], nowhere]), "labels": np.zeros((batch, 3), np.int64)},
        input_shape=[batch, *shape],
        input_dtype=dtype,
    )
    detector = load_detector(path)
    assert detector.description.manifest.layout == layout
    np.testing.assert_allclose(
        detector.detect(IMAGE).xyxy, PEOPLE[np.argsort(-SCORES)] - 0.5, atol=2e-3
    )


def test_a_pose_model_is_refused_by_name(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "rtmpose.onnx",
        {
            "simcc_x": np.zeros((1, 17, 96), np.float32),
            "simcc_y": np.zeros((1, 17, 128), np.float32),
        },
        input_shape=[1, 3, 64, 48],
    )
    with pytest.raises(
        ModelError, match=r"rtmpose\.onnx: is a pose model .*17.* expected a person"
    ):
        load_detector(path)


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("picodet_s_320_pedestrian", "boxes-scores"),
        ("yolox_nano", "yolox"),
        ("rtmdet_nano", "dets-labels"),
    ],
)
def test_real_detectors_find_the_dancer(name: str, form: str, shared: Path) -> None:
    detector = load_detector(shared / "models" / f"{name}.onnx")
    assert detector.description.form == form
    image = frame_of(shared / "videos" / "contemporary_dance.mp4", 200)
    boxes = detector.detect(image)
    assert len(boxes) == 1
    assert boxes.confidence[0] > 0.8
    # Marked by hand on this frame: from the hair to the right heel, hand to back.
    np.testing.assert_allclose(boxes.xyxy[0], [122, 60, 282, 428], atol=14)


def frame_of(video: Path, number: int) -> npt.NDArray[np.uint8]:
    import av

    with av.open(str(video)) as container:
        for i, frame in enumerate(container.decode(video=0)):
            if i == number:
                return np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)
    raise AssertionError(f"{video} has no frame {number}")
