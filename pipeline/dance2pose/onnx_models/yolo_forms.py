"""Output forms of the YOLO family without NMS inside: one row or column a cell of the grids."""

from __future__ import annotations

from typing import Any

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
    xyxy_from_centre,
)
from dance2pose.onnx_models.inference import Array, TensorInfo
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.presets import ULTRALYTICS_INPUT, YOLOX_INPUT

YOLO_STRIDES = ((8, 16, 32), (8, 16, 32, 64))

_YOLOX_PRESET = {**YOLOX_INPUT, "score_threshold": 0.3, "nms_threshold": 0.45}
_YOLOX_ASSUMED = ["BGR 0-255 as YOLOX is trained since its release 0.1.1"]
ULTRALYTICS_ASSUMED = ["RGB 0-1, letterboxed to the centre, as Ultralytics trains"]

# Without objectness, a row of this many values holds a box and COCO's 80 classes.
_COCO_ROW = 84


def yolo_strides(graph: Graph, rows: int | None, anchors: int = 1) -> tuple[int, ...] | None:
    """The strides whose grids over the input have `rows` cells (times `anchors`)."""
    return next((s for s in YOLO_STRIDES if anchors * graph.grid_cells(s) == rows), None)


def is_grid(graph: Graph, rows: int | None) -> bool:
    """Whether `rows` are the cells of a YOLO's grids, rather than the boxes after NMS."""
    return any(yolo_strides(graph, rows, anchors=n) for n in (1, 3))


def ultralytics(graph: Graph) -> dict[str, Any]:
    """What Ultralytics' exports are published with."""
    return {
        **ULTRALYTICS_INPUT,
        "score_threshold": 0.3,
        "nms_threshold": 0.6,
        "person_class": graph.person_class,
    }


def _box_unit(values: Array | None) -> dict[str, str]:
    """Some conversions (TFLite) give boxes as fractions of the picture."""
    fractions = values is not None and evidence.are_fractions(values[:, :4])
    return {"box_unit": "fractions"} if fractions else {}


# Rows of box, objectness, classes -------------------------------------------------------------


def _objectness_rows(graph: Graph) -> tuple[TensorInfo, int] | None:
    """The output of rows of box, objectness and classes, and how many classes; else None."""
    tensor = only_output(graph, 3)
    if tensor is None or (tensor.shape[2] or 0) < 6 or _without_objectness(graph, tensor):
        return None
    values = graph.values(tensor)
    if values is not None and not evidence.are_scores(values[:, 4:]):
        return None
    if values is not None and np.any(values) and evidence.are_classes(values[:, 5]):
        return None  # a class's number, not its score
    return tensor, (tensor.shape[2] or 0) - 5


def _match_yolox(graph: Graph) -> Match | None:
    found = _objectness_rows(graph)
    if found is None:
        return None
    tensor, classes = found
    strides = yolo_strides(graph, tensor.shape[1])
    if strides is None or _decoded_inside(graph):
        return None
    return Match(
        {"rows": tensor.name},
        [
            f"{tensor}: {tensor.shape[1]} rows are the grids of strides "
            f"{', '.join(map(str, strides))} over {graph.width}x{graph.height}",
            f"{tensor.shape[2]} columns are 4 for the box, objectness, {classes} classes",
            "on a grey picture the box centres stay near 0: offsets on the grid, not pixels",
        ],
        _YOLOX_PRESET,
        _YOLOX_ASSUMED,
        classes=classes,
    )


def _decoded_inside(graph: Graph) -> bool:
    """Whether the box centres already cover the picture."""
    return bool(np.abs(graph.probe[0][0, :, 0]).max() > graph.width / 4)


def _decode_yolox(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"][0]
    grid, stride = _grid(len(rows), manifest)
    # Only the likely rows are decoded: the exponential of all of them costs more than the rest.
    score = rows[:, 4] * rows[:, 5 + manifest.person_class]
    likely = np.flatnonzero(score >= manifest.score_threshold)
    rows, grid, stride = rows[likely], grid[likely], stride[likely]
    centre = (rows[:, :2] + grid) * stride
    size = np.exp(np.minimum(rows[:, 2:4], 20.0)) * stride
    boxes = xyxy_from_centre(np.concatenate([centre, size], axis=1))
    return Detections(boxes, score[likely], best_score=score.max(initial=0))


def _grid(rows: int, manifest: Manifest) -> tuple[Array, Array]:
    """Cell corner (rows, 2) and stride (rows, 1) of every row of a YOLOX output."""
    width, height = manifest.input_width, manifest.input_height
    for strides in YOLO_STRIDES:
        cells = []
        for stride in strides:
            y, x = np.mgrid[0 : -(-height // stride), 0 : -(-width // stride)]
            cells.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, stride)], axis=1))
        grid = np.concatenate(cells).astype(np.float32)
        if len(grid) == rows:
            break
    return grid[:, :2], grid[:, 2:]


def _match_yolov5(graph: Graph) -> Match | None:
    """YOLOv5, and YOLOX with its decoding inside: pixels, objectness, classes."""
    found = _objectness_rows(graph)
    if found is None:
        return None
    tensor, classes = found
    unit = _box_unit(graph.values(tensor))
    rows = f"{tensor}: 4 columns for the box, objectness, {classes} classes"
    if yolo_strides(graph, tensor.shape[1], anchors=3):
        return Match(
            {"rows": tensor.name},
            [rows, f"{tensor.shape[1]} rows are 3 anchors a cell over the grids, as in YOLOv5"],
            ultralytics(graph) | unit,
            ULTRALYTICS_ASSUMED,
            classes=classes,
        )
    if yolo_strides(graph, tensor.shape[1]):
        return Match(
            {"rows": tensor.name},
            [rows, "one row a grid cell with centres in pixels: YOLOX, decoded inside the graph"],
            _YOLOX_PRESET | unit,
            _YOLOX_ASSUMED,
            classes=classes,
        )
    return None


def _decode_yolov5(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"][0]
    score = rows[:, 4] * rows[:, 5 + manifest.person_class]
    return Detections(in_pixels(xyxy_from_centre(rows), manifest), score)


# YOLOv8 / YOLO11: one column a cell, classes without objectness -------------------------------


def _without_objectness(graph: Graph, tensor: TensorInfo) -> bool:
    """Whether rows [1, cells, 4 + classes] have no objectness: YOLOv8's columns, transposed."""
    names = len(graph.class_names)
    columns = tensor.shape[2] or 0
    return columns == 4 + names if names else columns in (5, _COCO_ROW)


def _match_yolov8(graph: Graph) -> Match | None:
    tensor = only_output(graph, 3)
    if tensor is None or graph.task == "pose":
        return None
    lengths = tensor.shape[1] or 0, tensor.shape[2] or 0
    turned = _without_objectness(graph, tensor) and yolo_strides(graph, lengths[0]) is not None
    cells, values_each = lengths if turned else lengths[::-1]
    if values_each < 5 or yolo_strides(graph, cells) is None:
        return None
    values = graph.values(tensor)
    if values is not None:
        values = values if turned else values.T
        if not evidence.are_scores(values[:, 4:]):
            return None
    return Match(
        {"columns": tensor.name},
        [
            f"{tensor}: {cells} {'rows' if turned else 'columns'} are the grids over "
            f"{graph.width}x{graph.height}",
            f"{values_each} {'columns' if turned else 'rows'} are 4 for the box and "
            f"{values_each - 4} classes, no objectness, as in YOLOv8 and YOLO11",
        ],
        ultralytics(graph) | _box_unit(values),
        ULTRALYTICS_ASSUMED,
        classes=values_each - 4,
    )


def _decode_yolov8(outputs: Outputs, manifest: Manifest) -> Detections:
    columns = outputs["columns"][0]
    if len(columns) > columns.shape[1]:  # there are always more cells than classes: rows
        columns = columns.T
    score = columns[4 + manifest.person_class]
    likely = np.flatnonzero(score >= manifest.score_threshold)
    boxes = in_pixels(xyxy_from_centre(columns[:4, likely].T), manifest)
    return Detections(boxes, score[likely], best_score=score.max(initial=0))


YOLO_FORMS = (
    OutputForm(
        "yolox",
        "detector",
        "[1, cells, 5 + classes] on the grid (YOLOX raw)",
        _match_yolox,
        _decode_yolox,
    ),
    OutputForm(
        "yolov5",
        "detector",
        "[1, 3 cells, 5 + classes] in pixels (YOLOv5; YOLOX decoded inside)",
        _match_yolov5,
        _decode_yolov5,
    ),
    OutputForm(
        "yolov8",
        "detector",
        "[1, 4 + classes, cells] in pixels, or transposed (YOLOv8, YOLO11)",
        _match_yolov8,
        _decode_yolov8,
    ),
)
