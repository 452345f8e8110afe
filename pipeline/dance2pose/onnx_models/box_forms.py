"""Output forms of detectors whose boxes, scores and classes are outputs of their own."""

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
    person_scores,
)
from dance2pose.onnx_models.inference import Array, TensorInfo
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.presets import (
    BYTES_INPUT,
    IMAGENET,
    PADDLE_INPUT,
    STRETCHED_INPUT,
    ULTRALYTICS_INPUT,
)
from dance2pose.onnx_models.yolo_forms import is_grid

# COCO's 80 classes are numbered 0 to 79, or 1 to 90 with holes: a person is 0, or 1. Those that
# follow DETR and torchvision take the second; 92 values hold "nothing" besides, the last one.
_PERSON_OF_CLASSES = {90: 1, 91: 1, 92: 1}
_CLASSES_FROM_ZERO = 80


def _boxes_of(values: Array | None) -> dict[str, str]:
    """Format and unit of boxes (N, 4), as far as their values tell them."""
    if values is None or not np.any(values):
        return {}
    shape = {} if evidence.are_corners(values) else {"box_format": "cxcywh"}
    return shape | ({"box_unit": "fractions"} if evidence.are_fractions(values) else {})


def _said(preset: dict[str, Any]) -> str:
    """Format and unit of boxes in words."""
    unit = "as fractions" if preset.get("box_unit") == "fractions" else "in pixels"
    return f"{preset.get('box_format', 'xyxy')} {unit}"


def _boxes_and_scores(graph: Graph) -> tuple[TensorInfo, TensorInfo] | None:
    """Boxes [1, A, 4] and scores of all classes [1, A, classes] or [1, classes, A]."""
    if len(graph.outputs) != 2 or any(len(t.shape) != 3 for t in graph.outputs):
        return None
    for boxes, scores in (graph.outputs, graph.outputs[::-1]):
        if boxes.shape[2] == 4 and boxes.shape[1] in scores.shape[1:]:
            return boxes, scores
    return None


# All cells, all classes: PicoDet, YOLO-NAS ----------------------------------------------------


def _match_boxes_scores(graph: Graph) -> Match | None:
    found = _boxes_and_scores(graph)
    if found is None:
        return None
    boxes, scores = found
    cells = boxes.shape[1]
    values = graph.values(scores)
    logits = values is not None and not evidence.are_scores(values)
    where = _boxes_of(graph.values(boxes))
    classes_last = scores.shape[2] != cells
    family = (
        ({**ULTRALYTICS_INPUT, "nms_threshold": 0.6}, "RGB 0-1, letterboxed, as YOLO-NAS trains")
        if classes_last and is_grid(graph, cells)
        else (
            {**PADDLE_INPUT, "nms_threshold": 0.5},
            "RGB with ImageNet's mean and std, not letterboxed, as PicoDet is trained",
        )
    )
    return Match(
        {"boxes": boxes.name, "scores": scores.name},
        [
            f"{boxes}: {cells} boxes, {_said(where)}; {scores}: their scores a class"
            f"{' as logits' if logits else ''}; no NMS inside"
        ],
        {
            **family[0],
            "score_threshold": 0.4,
            "score_activation": "sigmoid" if logits else "none",
            **where,
        },
        [family[1]],
        classes=scores.shape[2] if classes_last else scores.shape[1],
    )


def _decode_boxes_scores(outputs: Outputs, manifest: Manifest) -> Detections:
    boxes, scores = outputs["boxes"][0], outputs["scores"][0]
    score = person_scores(scores if scores.shape[-1] != len(boxes) else scores.T, manifest)
    likely = np.flatnonzero(score >= manifest.score_threshold)
    return Detections(
        in_pixels(boxes[likely], manifest), score[likely], best_score=score.max(initial=0)
    )


# Queries, one a person: DETR and its kin ------------------------------------------------------


def _match_queries(graph: Graph) -> Match | None:
    """Boxes as fractions and a row of class logits for each of a few hundred queries."""
    found = _boxes_and_scores(graph)
    if found is None or found[0].shape[1] != found[1].shape[1] or is_grid(graph, found[0].shape[1]):
        return None
    boxes, scores = found
    box_values, values = graph.values(boxes), graph.values(scores)
    named = "pred_boxes" in boxes.name.lower() or "logits" in scores.name.lower()
    if not (named if box_values is None else evidence.are_fractions(box_values)):
        return None
    classes = scores.shape[2] or 0
    activation = _activation(values, classes)
    named_person = graph.person_class if graph.class_names else None
    person = _PERSON_OF_CLASSES.get(classes, 0) if named_person is None else named_person
    # The model's family is told by how it counts COCO's classes.
    as_rtdetr = classes <= _CLASSES_FROM_ZERO
    where = {"box_format": "cxcywh", "box_unit": "fractions"} | _boxes_of(box_values)
    return Match(
        {"boxes": boxes.name, "scores": scores.name},
        [
            f"{boxes}: a box a query, {_said(where)}; {scores}: {classes} classes "
            f"({'scores' if activation == 'none' else f'logits, {activation}'}), as DETR",
        ],
        {
            **(STRETCHED_INPUT if as_rtdetr else STRETCHED_INPUT | IMAGENET),
            "score_threshold": 0.4,
            "person_class": person,
            "score_activation": activation,
            **where,
        },
        [
            f"RGB {'0-1' if as_rtdetr else 'normalised by mean and std of ImageNet'}, "
            f"not letterboxed, person is class {person} of {classes}: the graph does not say"
        ],
        classes=classes,
    )


def _activation(values: Array | None, classes: int) -> str:
    """How the classes' values become scores: they are scores, or sigmoid or softmax of them."""
    if values is not None and evidence.are_scores(values):
        return "none"
    with_nothing = 92
    if values is None or not len(values):
        return "softmax" if classes == with_nothing else "sigmoid"
    # Softmax heads say of a grey picture that nearly all queries are the last class: nothing.
    nothing = np.mean(values.argmax(axis=1) == classes - 1)
    return "softmax" if classes > 1 and (classes == with_nothing or nothing > 0.9) else "sigmoid"


# NMS inside: boxes, scores and classes apart --------------------------------------------------

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
    values = graph.values(scores), graph.values(classes)
    if any(v is not None and not fits(v) for v, fits in zip(
        values, (evidence.are_scores, evidence.are_classes), strict=True
    )):  # fmt: skip
        return None
    as_torchvision = len(boxes.shape) == 2
    person, why = _person_of_labels(graph, values[1], as_torchvision=as_torchvision)
    where = _boxes_of(graph.values(boxes))
    # torchvision's detectors keep the aspect of what they are given; the others are stretched to.
    given = ULTRALYTICS_INPUT if as_torchvision else STRETCHED_INPUT
    return Match(
        roles,
        reasons,
        {**given, "score_threshold": 0.4, "person_class": person, **where},
        [
            f"RGB 0-1, {'letterboxed' if as_torchvision else 'not letterboxed'}, boxes "
            f"{_said(where)}, person is class {person}: {why}"
        ],
    )


def _person_of_labels(
    graph: Graph, labels: Array | None, *, as_torchvision: bool
) -> tuple[int, str]:
    """Which label is a person, and why.

    Where 0 is the background, as in torchvision, it is never given; where classes are counted from
    0, COCO's end at 79.
    """
    if graph.class_names:
        return graph.person_class, "the metadata say so"
    seen = np.unique(labels) if labels is not None else np.empty(0)
    if 0 in seen:
        return 0, "the graph does not say"
    if as_torchvision:
        return 1, "no axis for the batch, as torchvision, which counts from 1"
    if seen.size and seen.max() >= _CLASSES_FROM_ZERO:
        return 1, f"class {seen.max():.0f} occurs, and COCO counted from 0 ends at 79"
    return 0, "the graph does not say"


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
    return Detections(in_pixels(boxes[people], manifest), scores[people])


BOX_FORMS = (
    OutputForm(
        "boxes-scores-classes",
        "detector",
        "[1, N, 4] boxes, [1, N] scores, [1, N] classes (RT-DETR, torchvision; NMS inside)",
        _match_boxes_scores_classes,
        _decode_boxes_scores_classes,
        has_nms=True,
    ),
    OutputForm(
        "queries",
        "detector",
        "[1, Q, 4] boxes as fractions, [1, Q, classes] logits (DETR, RT-DETR, D-FINE, YOLOS)",
        _match_queries,
        _decode_boxes_scores,
        has_nms=True,
    ),
    OutputForm(
        "boxes-scores",
        "detector",
        "[1, A, 4] boxes, [1, classes, A] scores (PicoDet without NMS, YOLO-NAS)",
        _match_boxes_scores,
        _decode_boxes_scores,
    ),
)
