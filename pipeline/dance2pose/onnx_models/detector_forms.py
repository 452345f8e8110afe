"""The output forms of person detectors."""

from __future__ import annotations

import numpy as np

from dance2pose.onnx_models.forms import (
    Detections,
    Graph,
    Match,
    OutputForm,
    Outputs,
    xyxy_from_centre,
)
from dance2pose.onnx_models.inference import Array, TensorInfo
from dance2pose.onnx_models.manifest import BoxFormat, Manifest

IMAGENET = {"mean": (123.675, 116.28, 103.53), "std": (58.395, 57.12, 57.375)}
YOLO_STRIDES = ((8, 16, 32), (8, 16, 32, 64))

# How the families were trained: colour order, normalisation, resize.
YOLOX_INPUT = {"colour_order": "BGR", "resize": "letterbox", "padding_position": "top-left"}
RTMDET_INPUT = {
    **YOLOX_INPUT,
    "mean": (103.53, 116.28, 123.675),
    "std": (57.375, 57.12, 58.395),
}
ULTRALYTICS_INPUT = {
    "colour_order": "RGB",
    "std": (255.0, 255.0, 255.0),
    "resize": "letterbox",
    "padding_position": "centre",
}
PADDLE_INPUT = {"colour_order": "RGB", **IMAGENET, "resize": "stretch"}
STRETCHED_INPUT = {"colour_order": "RGB", "std": (255.0, 255.0, 255.0), "resize": "stretch"}
BYTES_INPUT = {"colour_order": "RGB", "resize": "stretch"}


def yolo_strides(graph: Graph, rows: int | None, anchors: int = 1) -> tuple[int, ...] | None:
    """The strides whose grids over the input have `rows` cells (times `anchors`)."""
    return next((s for s in YOLO_STRIDES if anchors * graph.grid_cells(s) == rows), None)


def _only(graph: Graph, dimensions: int) -> TensorInfo | None:
    tensor = graph.outputs[0]
    return tensor if len(graph.outputs) == 1 and len(tensor.shape) == dimensions else None


# YOLOX: offsets and sizes on the grid, objectness, classes -------------------------------------


def _match_yolox(graph: Graph) -> Match | None:
    tensor = _only(graph, 3)
    if tensor is None or (tensor.shape[2] or 0) < 6:
        return None
    strides = yolo_strides(graph, tensor.shape[1])
    if strides is None or _decoded_inside(graph):
        return None
    return Match(
        {"rows": tensor.name},
        [
            f"{tensor}: {tensor.shape[1]} rows are the grids of strides "
            f"{', '.join(map(str, strides))} over {graph.width}x{graph.height}",
            f"{tensor.shape[2]} columns are 4 for the box, objectness, "
            f"{(tensor.shape[2] or 0) - 5} classes",
            "on a grey picture the box centres stay near 0: offsets on the grid, not pixels",
        ],
        {**YOLOX_INPUT, "score_threshold": 0.3, "nms_threshold": 0.45},
        ["BGR 0-255 as YOLOX is trained since its release 0.1.1"],
        classes=(tensor.shape[2] or 0) - 5,
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
    return Detections(xyxy_from_centre(np.concatenate([centre, size], axis=1)), score[likely])


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


# YOLOv5 and YOLOX with its decoding inside: pixels, objectness, classes -----------------------


def _match_yolov5(graph: Graph) -> Match | None:
    tensor = _only(graph, 3)
    if tensor is None or (tensor.shape[2] or 0) < 6:
        return None
    rows = f"{tensor}: 4 columns for the box, objectness, {(tensor.shape[2] or 0) - 5} classes"
    if yolo_strides(graph, tensor.shape[1], anchors=3):
        return Match(
            {"rows": tensor.name},
            [rows, f"{tensor.shape[1]} rows are 3 anchors a cell over the grids, as in YOLOv5"],
            _ultralytics(graph),
            ["RGB 0-1, letterboxed to the centre, as Ultralytics trains"],
            classes=(tensor.shape[2] or 0) - 5,
        )
    if yolo_strides(graph, tensor.shape[1]):
        return Match(
            {"rows": tensor.name},
            [rows, "one row a grid cell with centres in pixels: YOLOX, decoded inside the graph"],
            {**YOLOX_INPUT, "score_threshold": 0.3, "nms_threshold": 0.45},
            ["BGR 0-255 as YOLOX is trained since its release 0.1.1"],
            classes=(tensor.shape[2] or 0) - 5,
        )
    return None


def _decode_yolov5(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"][0]
    score = rows[:, 4] * rows[:, 5 + manifest.person_class]
    return Detections(xyxy_from_centre(rows), score)


# YOLOv8 / YOLO11: one column a cell, classes without objectness -------------------------------


def _match_yolov8(graph: Graph) -> Match | None:
    tensor = _only(graph, 3)
    if tensor is None or graph.task == "pose":
        return None
    columns, cells = tensor.shape[1] or 0, tensor.shape[2]
    if columns < 5 or yolo_strides(graph, cells) is None:
        return None
    return Match(
        {"columns": tensor.name},
        [
            f"{tensor}: {cells} columns are the grids over {graph.width}x{graph.height}",
            f"{columns} rows are 4 for the box and {columns - 4} classes, no objectness, "
            "as in YOLOv8 and YOLO11",
        ],
        _ultralytics(graph),
        ["RGB 0-1, letterboxed to the centre, as Ultralytics trains"],
        classes=columns - 4,
    )


def _ultralytics(graph: Graph) -> dict[str, object]:
    return {
        **ULTRALYTICS_INPUT,
        "score_threshold": 0.3,
        "nms_threshold": 0.6,
        "person_class": graph.person_class,
    }


def _decode_yolov8(outputs: Outputs, manifest: Manifest) -> Detections:
    columns = outputs["columns"][0]
    score = columns[4 + manifest.person_class]
    likely = np.flatnonzero(score >= manifest.score_threshold)
    return Detections(xyxy_from_centre(columns[:4, likely].T), score[likely])


# MMDetection's deployment: dets and labels, NMS inside ----------------------------------------


def _match_dets_labels(graph: Graph) -> Match | None:
    rows = [t for t in graph.outputs if len(t.shape) == 3 and t.shape[2] == 5]
    labels = [t for t in graph.outputs if len(t.shape) == 2 and t.dtype.kind == "i"]
    if len(graph.outputs) != 2 or not rows or not labels:
        return None
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
        said = f"BGR with mean and std as RTMDet is trained ({why})"
        return {**RTMDET_INPUT, "score_threshold": 0.3}, [said]
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


# PicoDet and others without NMS: boxes of all cells, scores of all classes --------------------


def _match_boxes_scores(graph: Graph) -> Match | None:
    if len(graph.outputs) != 2 or any(len(t.shape) != 3 for t in graph.outputs):
        return None
    for boxes, scores in (graph.outputs, graph.outputs[::-1]):
        cells = boxes.shape[1]
        if boxes.shape[2] != 4 or cells not in scores.shape[1:]:
            continue
        return Match(
            {"boxes": boxes.name, "scores": scores.name},
            [
                f"{boxes}: {cells} boxes; {scores}: their scores a class; no NMS inside",
            ],
            {**PADDLE_INPUT, "score_threshold": 0.4, "nms_threshold": 0.5},
            ["RGB with ImageNet's mean and std, not letterboxed, as PicoDet is trained"],
            classes=scores.shape[1] if scores.shape[2] == cells else scores.shape[2],
        )
    return None


def _decode_boxes_scores(outputs: Outputs, manifest: Manifest) -> Detections:
    boxes, scores = outputs["boxes"][0], outputs["scores"][0]
    by_class = scores if scores.shape[-1] == len(boxes) else scores.T
    score = by_class[manifest.person_class]
    likely = np.flatnonzero(score >= manifest.score_threshold)
    return Detections(_corners(boxes[likely], manifest), score[likely])


# NMS inside, one row a box --------------------------------------------------------------------


def _match_rows(graph: Graph) -> Match | None:
    """Ultralytics' YOLOv10, YOLO26 and nms=True: [1, N, 6]."""
    tensor = _only(graph, 3)
    if tensor is None or tensor.shape[2] != 6:
        return None
    if any(yolo_strides(graph, tensor.shape[1], anchors=n) for n in (1, 3)):
        return None
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: at most {tensor.shape[1]} boxes as xyxy, score, class; NMS inside"],
        _ultralytics(graph),
        ["RGB 0-1, letterboxed to the centre, as Ultralytics trains"],
    )


def _decode_rows(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"][0]
    rows = rows[rows[:, 5].round() == manifest.person_class]
    return Detections(rows[:, :4], rows[:, 4])


def _match_paddle_rows(graph: Graph) -> Match | None:
    """PaddleDetection with NMS: [N, 6] and how many of them belong to each picture."""
    rows = [t for t in graph.outputs if len(t.shape) == 2 and t.shape[1] == 6]
    if not rows or len(graph.outputs) > 2:
        return None
    return Match(
        {"rows": rows[0].name},
        [f"{rows[0]}: boxes as class, score, xyxy; NMS inside, as PaddleDetection exports"],
        {**PADDLE_INPUT, "score_threshold": 0.4},
        ["RGB with ImageNet's mean and std, not letterboxed, as PaddleDetection trains"],
    )


def _decode_paddle_rows(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"]
    rows = rows[rows[:, 0].round() == manifest.person_class]
    return Detections(rows[:, 2:6], rows[:, 1])


def _match_yolov7_rows(graph: Graph) -> Match | None:
    """YOLOv7's end-to-end export: [N, 7]."""
    tensor = _only(graph, 2)
    if tensor is None or tensor.shape[1] != 7:
        return None
    return Match(
        {"rows": tensor.name},
        [f"{tensor}: boxes as picture, xyxy, class, score; NMS inside, as YOLOv7 exports"],
        _ultralytics(graph),
        ["RGB 0-1, letterboxed to the centre, as YOLOv7 is trained"],
    )


def _decode_yolov7_rows(outputs: Outputs, manifest: Manifest) -> Detections:
    rows = outputs["rows"]
    rows = rows[(rows[:, 0].round() == 0) & (rows[:, 5].round() == manifest.person_class)]
    return Detections(rows[:, 1:5], rows[:, 6])


# NMS inside, boxes, scores and classes apart --------------------------------------------------

_TF_NAMES = ("detection_boxes", "detection_scores", "detection_classes")


def _match_boxes_scores_classes(graph: Graph) -> Match | None:
    tf_outputs = graph.named(*_TF_NAMES)
    boxes, scores, classes = tf_outputs or _boxes_scores_classes(graph) or (None, None, None)
    if boxes is None or scores is None or classes is None:
        return None
    reasons = [f"{boxes}: boxes; {scores}: scores; {classes}: classes; NMS inside"]
    roles = {"boxes": boxes.name, "scores": scores.name, "classes": classes.name}
    if tf_outputs:
        return Match(
            roles,
            [*reasons, "names of TensorFlow's object detection: y, x in fractions, person is 1"],
            {
                **(BYTES_INPUT if graph.image.dtype.kind != "f" else STRETCHED_INPUT),
                "box_format": "yxyx",
                "box_unit": "fractions",
                "person_class": 1,
                "score_threshold": 0.4,
            },
            ["RGB, not letterboxed, as TensorFlow's detectors are trained"],
        )
    return Match(
        roles,
        reasons,
        {**STRETCHED_INPUT, "score_threshold": 0.4, "person_class": graph.person_class},
        ["RGB 0-1, not letterboxed, boxes xyxy in pixels, person is class "
         f"{graph.person_class}: the graph does not say"],
    )  # fmt: skip


def _boxes_scores_classes(graph: Graph) -> tuple[TensorInfo, TensorInfo, TensorInfo] | None:
    """Boxes [.., N, 4]; classes are the integers, or named so; scores the other [.., N]."""
    boxes = max(graph.outputs, key=lambda t: len(t.shape))
    if len(boxes.shape) not in (2, 3) or boxes.shape[-1] != 4:
        return None
    lists = [t for t in graph.outputs if t.shape == boxes.shape[:-1]]
    classes = [t for t in lists if t.dtype.kind == "i"] or [
        t for t in lists if "class" in t.name.lower() or "label" in t.name.lower()
    ]
    scores = [t for t in lists if t.dtype.kind == "f" and t not in classes]
    return (boxes, scores[0], classes[0]) if len(classes) == len(scores) == 1 else None


def _decode_boxes_scores_classes(outputs: Outputs, manifest: Manifest) -> Detections:
    boxes, scores, classes = outputs["boxes"], outputs["scores"], outputs["classes"]
    if boxes.ndim == 3:
        boxes, scores, classes = boxes[0], scores[0], classes[0]
    people = np.rint(classes) == manifest.person_class
    return Detections(_corners(boxes[people], manifest), scores[people])


def _corners(boxes: Array, manifest: Manifest) -> Array:
    """Boxes (N, 4) of any format and unit as xyxy in pixels of the network's input."""
    box_format: BoxFormat = manifest.box_format
    if box_format == "yxyx":
        boxes = boxes[:, [1, 0, 3, 2]]
    elif box_format == "cxcywh":
        boxes = xyxy_from_centre(boxes)
    elif box_format == "xywh":
        boxes = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    if manifest.box_unit == "fractions":
        width, height = manifest.input_width, manifest.input_height
        boxes = boxes * np.array([width, height, width, height], np.float32)
    return boxes.astype(np.float32)


DETECTOR_FORMS = (
    OutputForm(
        "dets-labels",
        "detector",
        "[1, N, 5] xyxy and score, [1, N] integer labels (RTMDet, YOLOX; NMS inside)",
        _match_dets_labels,
        _decode_dets_labels,
        has_nms=True,
    ),
    OutputForm(
        "boxes-scores-classes",
        "detector",
        "[1, N, 4] boxes, [1, N] scores, [1, N] classes (RT-DETR, torchvision; NMS inside)",
        _match_boxes_scores_classes,
        _decode_boxes_scores_classes,
        has_nms=True,
    ),
    OutputForm(
        "boxes-scores",
        "detector",
        "[1, A, 4] boxes, [1, classes, A] scores (PicoDet without NMS)",
        _match_boxes_scores,
        _decode_boxes_scores,
    ),
    OutputForm(
        "rows-class-score-xyxy",
        "detector",
        "[N, 6] class, score, xyxy (PaddleDetection; NMS inside)",
        _match_paddle_rows,
        _decode_paddle_rows,
        has_nms=True,
    ),
    OutputForm(
        "rows-batch-xyxy-class-score",
        "detector",
        "[N, 7] picture, xyxy, class, score (YOLOv7 end to end; NMS inside)",
        _match_yolov7_rows,
        _decode_yolov7_rows,
        has_nms=True,
    ),
    OutputForm(
        "rows-xyxy-score-class",
        "detector",
        "[1, N, 6] xyxy, score, class (YOLOv10, YOLO26, exports with nms=True)",
        _match_rows,
        _decode_rows,
        has_nms=True,
    ),
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
        "[1, 4 + classes, cells] in pixels (YOLOv8, YOLO11)",
        _match_yolov8,
        _decode_yolov8,
    ),
)
