"""Output forms of detectors that give one row a box: its corners, its score and its class.

The order of the columns differs; where the probe finds anything at all, its values tell.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dance2pose.onnx_models import evidence
from dance2pose.onnx_models.forms import (
    Detections,
    Graph,
    Match,
    OutputForm,
    Outputs,
    in_pixels,
    only_output,
)
from dance2pose.onnx_models.inference import Array, TensorInfo
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.presets import PADDLE_INPUT, RTMDET_INPUT, YOLOX_INPUT
from dance2pose.onnx_models.yolo_forms import ULTRALYTICS_ASSUMED, is_grid, ultralytics


class Columns(NamedTuple):
    """Where a row of six holds what. box: the first of its four columns."""

    box: int
    score: int
    label: int

    def fit(self, rows: Array) -> bool:
        """Whether the values of rows (N, 6) can be in this order."""
        box, score, label = self.split(rows)
        return (
            evidence.are_scores(score)
            and evidence.are_classes(label)
            and evidence.are_corners(evidence.sure(box, score))
        )

    def find(self, rows: Array) -> bool:
        """Whether a row has a score above noise in this order."""
        box, score, _ = self.split(rows)
        return len(evidence.sure(box, score)) > 0

    def split(self, rows: Array) -> tuple[Array, Array, Array]:
        """Boxes (N, 4), scores (N,) and classes (N,)."""
        return rows[:, self.box : self.box + 4], rows[:, self.score], rows[:, self.label]


SCORE_CLASS = Columns(0, 4, 5)
CLASS_SCORE = Columns(0, 5, 4)
CLASS_FIRST = Columns(2, 1, 0)


def _rows_of_six(graph: Graph) -> tuple[TensorInfo, Array | None, bool] | None:
    """The output of rows of six, its values, and whether it has an axis for the batch."""
    tensors = [t for t in graph.outputs if len(t.shape) in (2, 3) and t.shape[-1] == 6]
    if len(tensors) != 1:
        return None
    batched = len(tensors[0].shape) == 3
    if len(graph.outputs) > (1 if batched else 2):  # Paddle counts the rows of each picture
        return None
    return tensors[0], graph.values(tensors[0]), batched


def _first_to_fit(values: Array | None, orders: tuple[Columns, ...]) -> Columns | None:
    if values is None:
        return orders[0]
    fitting = [columns for columns in orders if columns.fit(values)]
    # Where one order finds somebody, scores of nothing but 0 in another are classes.
    finding = [columns for columns in fitting if columns.find(values)]
    return next(iter(finding or fitting), None)


def _unit(values: Array | None, columns: Columns) -> dict[str, str]:
    fractions = values is not None and evidence.are_fractions(columns.split(values)[0])
    return {"box_unit": "fractions"} if fractions else {}


def _match_rows(graph: Graph, wanted: Columns, words: str) -> Match | None:
    found = _rows_of_six(graph)
    if found is None:
        return None
    tensor, values, batched = found
    if batched and is_grid(graph, tensor.shape[1]):
        return None
    # Where the values fit several orders (nothing was found), the one that is published so wins.
    published = (SCORE_CLASS, CLASS_SCORE, CLASS_FIRST)
    if _first_to_fit(values, published if batched else published[::-1]) != wanted:
        return None
    family = _paddle() if wanted == CLASS_FIRST else (ultralytics(graph), ULTRALYTICS_ASSUMED)
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: boxes as {words}; NMS inside"],
        family[0] | _unit(values, wanted),
        family[1],
    )


def _paddle() -> tuple[dict[str, Any], list[str]]:
    return (
        {**PADDLE_INPUT, "score_threshold": 0.4},
        ["RGB with ImageNet's mean and std, not letterboxed, as PaddleDetection trains"],
    )


def _decode_rows(outputs: Outputs, manifest: Manifest, columns: Columns) -> Detections:
    rows = outputs["rows"]
    box, score, label = columns.split(rows[0] if rows.ndim == 3 else rows)
    if not evidence.are_classes(label):
        raise ValueError("the numbers it gives for classes are not whole")
    people = np.rint(label) == manifest.person_class
    return Detections(in_pixels(box[people], manifest), score[people])


def _match_cells(graph: Graph) -> Match | None:
    """A YOLO whose classes were reduced to the surest one, but whose NMS was left out."""
    found = _rows_of_six(graph)
    if found is None or not found[2] or not is_grid(graph, found[0].shape[1]):
        return None
    tensor, values, _ = found
    if values is None or not np.any(values) or not SCORE_CLASS.fit(values):
        return None
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: a box a grid cell as xyxy, score, class (whole numbers); no NMS inside"],
        ultralytics(graph) | _unit(values, SCORE_CLASS),
        ULTRALYTICS_ASSUMED,
    )


# YOLOv7 end to end ----------------------------------------------------------------------------


def _match_yolov7_rows(graph: Graph) -> Match | None:
    """YOLOv7's end-to-end export: [N, 7]."""
    tensor = only_output(graph, 2)
    if tensor is None or tensor.shape[1] != 7:
        return None
    values = graph.values(tensor)
    if values is not None and not CLASS_SCORE.fit(values[:, 1:]):
        return None
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: boxes as picture, xyxy, class, score; NMS inside, as YOLOv7 exports"],
        ultralytics(graph),
        ["RGB 0-1, letterboxed to the centre, as YOLOv7 is trained"],
    )


def _decode_yolov7_rows(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"]
    rows = rows[(rows[:, 0].round() == 0) & (rows[:, 5].round() == manifest.person_class)]
    return Detections(rows[:, 1:5], rows[:, 6])


# MMDetection's deployment: dets and labels ----------------------------------------------------


def _match_dets_labels(graph: Graph) -> Match | None:
    rows = [t for t in graph.outputs if len(t.shape) == 3 and t.shape[2] == 5]
    labels = [t for t in graph.outputs if len(t.shape) == 2 and t.dtype.kind == "i"]
    if len(graph.outputs) != 2 or not rows or not labels or labels[0].shape[1] != rows[0].shape[1]:
        return None
    values = graph.values(rows[0])
    if values is not None and not evidence.are_scores(values[:, 4]):
        return None  # the angle of a turned box, for one
    preset, assumed = _mmdetection_family(graph)
    return Match(
        {"dets": rows[0].name, "labels": labels[0].name},
        [f"{rows[0]}: boxes xyxy and score; {labels[0]}: their classes; NMS inside"],
        preset,
        assumed,
        default_size=(320, 320),
    )


def _mmdetection_family(graph: Graph) -> tuple[dict[str, object], list[str]]:
    """RTMDet and YOLOX are deployed alike but trained with other inputs: the weights' names tell.

    RTMDet wants mean and standard deviation, YOLOX bare 0-255.
    """
    word = graph.session.mentions("rtm_cls", "multi_level_conv_obj", "obj_preds")
    name = graph.session.path.name.lower()
    if word == "rtm_cls" or (word is None and "rtmdet" in name):
        why = f"weights named {word}" if word else "file name"
        note = f"BGR with mean and std as RTMDet is trained ({why})"
        return {**RTMDET_INPUT, "score_threshold": 0.3}, [note]
    if word or "yolox" in name:
        why = f"weights named {word}" if word else "file name"
        return {**YOLOX_INPUT, "score_threshold": 0.3}, [f"BGR 0-255 as YOLOX is trained ({why})"]
    return (
        {**RTMDET_INPUT, "score_threshold": 0.3},
        ["BGR with RTMDet's mean and std: nothing in the file tells; YOLOX wants std 1 and mean 0"],
    )


def _decode_dets_labels(outputs: Outputs, manifest: Manifest) -> Detections:
    dets, labels = outputs["dets"][0], outputs["labels"][0]
    dets = dets[labels == manifest.person_class]
    return Detections(dets[:, :4], dets[:, 4])


ROW_FORMS = (
    OutputForm(
        "dets-labels",
        "detector",
        "[1, N, 5] xyxy and score, [1, N] integer labels (RTMDet, YOLOX; NMS inside)",
        _match_dets_labels,
        _decode_dets_labels,
        has_nms=True,
    ),
    OutputForm(
        "rows-class-score-xyxy",
        "detector",
        "[N, 6] class, score, xyxy (PaddleDetection; NMS inside)",
        lambda graph: _match_rows(graph, CLASS_FIRST, "class, score, xyxy"),
        lambda outputs, manifest: _decode_rows(outputs, manifest, CLASS_FIRST),
        has_nms=True,
    ),
    OutputForm(
        "rows-xyxy-class-score",
        "detector",
        "[1, N, 6] xyxy, class, score (NMS inside)",
        lambda graph: _match_rows(graph, CLASS_SCORE, "xyxy, class, score"),
        lambda outputs, manifest: _decode_rows(outputs, manifest, CLASS_SCORE),
        has_nms=True,
    ),
    OutputForm(
        "rows-xyxy-score-class",
        "detector",
        "[1, N, 6] xyxy, score, class (YOLOv10, YOLO26, exports with nms=True)",
        lambda graph: _match_rows(graph, SCORE_CLASS, "xyxy, score, class"),
        lambda outputs, manifest: _decode_rows(outputs, manifest, SCORE_CLASS),
        has_nms=True,
    ),
    OutputForm(
        "cells-xyxy-score-class",
        "detector",
        "[1, cells, 6] xyxy, score, class (YOLO with its surest class, without NMS)",
        _match_cells,
        lambda outputs, manifest: _decode_rows(outputs, manifest, SCORE_CLASS),
    ),
    OutputForm(
        "rows-batch-xyxy-class-score",
        "detector",
        "[N, 7] picture, xyxy, class, score (YOLOv7 end to end; NMS inside)",
        _match_yolov7_rows,
        _decode_yolov7_rows,
        has_nms=True,
    ),
)
