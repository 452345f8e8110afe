"""The output forms of one-stage pose models: the whole picture -> boxes and keypoints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dance2pose.onnx_models import evidence
from dance2pose.onnx_models.forms import (
    Detections,
    Graph,
    Match,
    OutputForm,
    Outputs,
    xyxy_from_centre,
)
from dance2pose.onnx_models.inference import Array
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.presets import ULTRALYTICS_INPUT, YOLOX_INPUT
from dance2pose.onnx_models.yolo_forms import ULTRALYTICS_ASSUMED, is_grid, yolo_strides
from dance2pose.skeleton import SKELETONS_BY_COUNT

# RTMO -----------------------------------------------------------------------------------------


def _match_rtmo(graph: Graph) -> Match | None:
    dets = [t for t in graph.outputs if len(t.shape) == 3 and t.shape[2] == 5]
    keypoints = [t for t in graph.outputs if len(t.shape) == 4 and t.shape[3] == 3]
    if len(graph.outputs) != 2 or not dets or not keypoints:
        return None
    return Match(
        {"dets": dets[0].name, "keypoints": keypoints[0].name},
        [f"{dets[0]}: boxes and score; {keypoints[0]}: x, y, score of their keypoints (RTMO)"],
        {**YOLOX_INPUT, "score_threshold": 0.3},
        ["BGR 0-255 as RTMO is trained"],
        keypoints=keypoints[0].shape[2],
        default_size=(640, 640),
    )


def _decode_rtmo(outputs: Outputs, manifest: Manifest) -> Detections:
    del manifest
    dets, keypoints = outputs["dets"][0], outputs["keypoints"][0]
    return Detections(dets[:, :4], dets[:, 4], keypoints[..., :2], keypoints[..., 2])


# YOLOv8-pose / YOLO11-pose --------------------------------------------------------------------

_ULTRALYTICS_POSE = {**ULTRALYTICS_INPUT, "score_threshold": 0.3, "nms_threshold": 0.6}


def _keypoint_count(graph: Graph, values: int) -> int | None:
    """How many keypoints of x, y, score `values` numbers hold, None where that fits nothing."""
    if graph.keypoint_shape is not None:
        keypoints, each = graph.keypoint_shape
        return keypoints if each == 3 and keypoints * 3 == values else None
    keypoints, rest = divmod(values, 3)
    return keypoints if rest == 0 and keypoints in SKELETONS_BY_COUNT else None


def _scores_where_expected(rows: Array, *, score: int, keypoints: int) -> bool:
    """Whether rows (N, columns) have scores in these columns: of the box, and of each keypoint
    behind its x and y."""
    return evidence.are_scores(rows[:, score]) and evidence.are_scores(rows[:, keypoints + 2 :: 3])


def _match_yolov8_pose(graph: Graph) -> Match | None:
    tensor = graph.outputs[0]
    if len(graph.outputs) != 1 or len(tensor.shape) != 3 or graph.task == "detect":
        return None
    keypoints = _keypoint_count(graph, (tensor.shape[1] or 0) - 5)
    if keypoints is None or yolo_strides(graph, tensor.shape[2]) is None:
        return None
    values = graph.values(tensor)
    if values is not None and not _scores_where_expected(values.T, score=4, keypoints=5):
        return None
    return Match(
        {"columns": tensor.name},
        [
            f"{tensor}: {tensor.shape[2]} columns are the grids over {graph.width}x{graph.height}",
            f"{tensor.shape[1]} rows are 4 for the box, a score, and {keypoints} keypoints "
            "of x, y, score, as in YOLOv8-pose and YOLO11-pose",
        ],
        _ULTRALYTICS_POSE,
        ULTRALYTICS_ASSUMED,
        keypoints=keypoints,
    )


def _decode_yolov8_pose(outputs: Outputs, manifest: Manifest) -> Detections:
    columns = outputs["columns"][0]
    rows = columns[:, columns[4] >= manifest.score_threshold].T
    found = _with_keypoints(xyxy_from_centre(rows), rows[:, 4], rows[:, 5:])
    return replace(found, best_score=float(columns[4].max(initial=0)))


def _with_keypoints(xyxy: Array, score: Array, values: Array) -> Detections:
    """values: (N, 3 K), x, y, score of every keypoint in turn, from the edge of the picture."""
    keypoints = values.reshape(len(values), values.shape[1] // 3, 3)
    return Detections(xyxy, score, keypoints[..., :2] - np.float32(0.5), keypoints[..., 2])


def _match_yolo_pose_rows(graph: Graph) -> Match | None:
    """Exports with nms=True and YOLO26-pose: [1, N, 6 + 3 K]."""
    tensor = graph.outputs[0]
    if len(graph.outputs) != 1 or len(tensor.shape) != 3 or graph.task == "detect":
        return None
    keypoints = _keypoint_count(graph, (tensor.shape[2] or 0) - 6)
    if keypoints is None or is_grid(graph, tensor.shape[1]):
        return None
    values = graph.values(tensor)
    if values is not None and not _scores_where_expected(values, score=4, keypoints=6):
        return None
    return Match(
        {"rows": tensor.name},
        [
            f"{tensor}: at most {tensor.shape[1]} people as xyxy, score, class and "
            f"{keypoints} keypoints of x, y, score; NMS inside"
        ],
        _ULTRALYTICS_POSE,
        ULTRALYTICS_ASSUMED,
        keypoints=keypoints,
    )


def _decode_yolo_pose_rows(outputs: Outputs, manifest: Manifest) -> Detections:
    del manifest
    rows = outputs["rows"][0]
    return _with_keypoints(rows[:, :4], rows[:, 4], rows[:, 6:])


# MoveNet, several people ----------------------------------------------------------------------


def _match_movenet_multipose(graph: Graph) -> Match | None:
    tensor = graph.outputs[0]
    if len(graph.outputs) != 1 or tensor.shape[1:] != (6, 56):
        return None
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: 6 people of 17 y, x, score and a box, as MoveNet multi-pose"],
        {"colour_order": "RGB", "resize": "letterbox", "padding_position": "top-left",
         "padding_value": 0, "score_threshold": 0.2},
        ["RGB 0-255"],
        keypoints=17,
        default_size=(256, 256),
    )  # fmt: skip


def _decode_movenet_multipose(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"][0]
    size = np.array([manifest.input_width, manifest.input_height], np.float32)
    keypoints = rows[:, :51].reshape(len(rows), 17, 3)
    corners = rows[:, [52, 51, 54, 53]] * np.tile(size, 2)
    return Detections(
        corners, rows[:, 55], keypoints[..., 1::-1] * size - np.float32(0.5), keypoints[..., 2]
    )


ONE_STAGE_FORMS = (
    OutputForm(
        "rtmo",
        "one-stage",
        "[1, N, 5] xyxy and score, [1, N, K, 3] keypoints (RTMO; NMS inside)",
        _match_rtmo,
        _decode_rtmo,
        has_nms=True,
    ),
    OutputForm(
        "movenet-multipose",
        "one-stage",
        "[1, 6, 56] (MoveNet multi-pose)",
        _match_movenet_multipose,
        _decode_movenet_multipose,
        has_nms=True,
    ),
    OutputForm(
        "yolov8-pose",
        "one-stage",
        "[1, 5 + 3 K, cells] (YOLOv8-pose, YOLO11-pose)",
        _match_yolov8_pose,
        _decode_yolov8_pose,
    ),
    OutputForm(
        "rows-xyxy-score-class-keypoints",
        "one-stage",
        "[1, N, 6 + 3 K] (YOLO-pose exports with nms=True, YOLO26-pose; NMS inside)",
        _match_yolo_pose_rows,
        _decode_yolo_pose_rows,
        has_nms=True,
    ),
)
