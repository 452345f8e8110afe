"""What an output form is: how it is told from a graph, and how its outputs are read.

A form belongs to one kind of model. `match` looks at the graph and says which output plays which
role, and why; `decode` turns the outputs, by role, into boxes and keypoints in pixels of the
network's input. The forms themselves are in detector_forms, pose_forms and one_stage_forms.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose.onnx_models.inference import Array, Session, TensorInfo
from dance2pose.onnx_models.manifest import Kind, Layout, Manifest

Outputs = Mapping[str, Array]
FloatMatrix = npt.NDArray[np.float32]


class Graph:
    """A loaded graph as the forms see it: shapes with their open lengths found by running it.

    width, height: of the input, px. `probe` runs the graph once on a flat grey picture.
    form_is_stated: by the manifest, so that values need not tell it.
    """

    def __init__(
        self,
        session: Session,
        image: TensorInfo,
        layout: Layout,
        width: int,
        height: int,
        *,
        form_is_stated: bool = False,
    ) -> None:
        self.form_is_stated = form_is_stated
        self.session = session
        self.image = image
        self.layout = layout
        self.width = width
        self.height = height
        self.metadata = session.metadata

    @cached_property
    def outputs(self) -> tuple[TensorInfo, ...]:
        """The outputs, their open lengths (but for the batch) replaced by those of the probe."""
        declared = self.session.outputs
        if all(None not in tensor.shape[1:] and tensor.shape for tensor in declared):
            return declared
        return tuple(
            TensorInfo(tensor.name, values.shape, values.dtype)
            for tensor, values in zip(declared, self.probe, strict=True)
        )

    @cached_property
    def probe(self) -> list[Array]:
        """Every output for one grey picture."""
        sides = (3, self.height, self.width)
        shape = sides if self.layout == "NCHW" else (*sides[1:], 3)
        batch = self.image.shape[0] or 1
        picture = np.full((batch, *shape), 1 if self.image.dtype.kind == "f" else 114)
        feeds = {self.image.name: picture.astype(self.image.dtype)}
        feeds |= extra_feeds(self.session, self.width, self.height)
        names = [tensor.name for tensor in self.session.outputs]
        return self.session.run(feeds, names, may_hold_nan=True)

    def values(self, tensor: TensorInfo) -> Array | None:
        """What the probe found of an output for its first picture, to judge it by.

        None where there is nothing to judge: the manifest states the form and is believed, or the
        model answers a grey picture with NaN.
        """
        if self.form_is_stated:
            return None
        index = next(i for i, output in enumerate(self.outputs) if output.name == tensor.name)
        values = self.probe[index]
        if values.ndim == 3:
            values = values[0]
        is_nan = values.dtype.kind == "f" and np.isnan(values).any()
        return None if is_nan else values

    def named(self, *names: str) -> list[TensorInfo] | None:
        """The outputs of these names in this order, None where one is missing."""
        by_name = {tensor.name: tensor for tensor in self.outputs}
        return [by_name[name] for name in names] if all(n in by_name for n in names) else None

    @cached_property
    def class_names(self) -> dict[int, str]:
        """What Ultralytics' exports say their classes are."""
        names = self._literal("names")
        return names if isinstance(names, dict) else {}

    @cached_property
    def task(self) -> str | None:
        """What Ultralytics' exports say they do: detect, pose."""
        return self.metadata.get("task")

    @property
    def person_class(self) -> int:
        return next((i for i, name in self.class_names.items() if name == "person"), 0)

    @property
    def keypoint_shape(self) -> tuple[int, int] | None:
        """(keypoints, values each) where Ultralytics' metadata say so."""
        shape = self._literal("kpt_shape")
        return (int(shape[0]), int(shape[1])) if isinstance(shape, list) else None

    def grid_cells(self, strides: tuple[int, ...]) -> int:
        """How many cells grids of these strides have over the input."""
        return sum(-(-self.width // s) * -(-self.height // s) for s in strides)

    def _literal(self, key: str) -> Any:
        try:
            return ast.literal_eval(self.metadata[key])
        except (KeyError, ValueError, SyntaxError):
            return None


# Inputs besides the picture that detectors with their post-processing inside may ask for. All
# are answered so that the boxes come out in pixels of the network's input.
_EXTRA_INPUTS: dict[str, Callable[[int, int], list[float]]] = {
    "scale_factor": lambda width, height: [1, 1],
    "im_shape": lambda width, height: [height, width],
    "orig_target_sizes": lambda width, height: [width, height],
}


def is_extra_input(tensor: TensorInfo) -> bool:
    return tensor.name in _EXTRA_INPUTS


def extra_feeds(session: Session, width: int, height: int) -> dict[str, Array]:
    """Values for the inputs that are not the picture."""
    return {
        tensor.name: np.array([_EXTRA_INPUTS[tensor.name](width, height)], tensor.dtype)
        for tensor in session.inputs
        if is_extra_input(tensor)
    }


@dataclass(frozen=True)
class Match:
    """What a form recognised.

    roles: role -> name of the output. reasons: why, a line each. preset: manifest settings that
    models of this form are published with. assumed: what no graph can show, a line each.
    keypoints: how many the model gives, None for a detector. classes: how many a detector tells
    apart, None where the graph does not show it. default_size: (width, height) of the input where
    the graph leaves it open.
    """

    roles: dict[str, str]
    reasons: list[str]
    preset: dict[str, Any] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)
    keypoints: int | None = None
    classes: int | None = None
    default_size: tuple[int, int] | None = None


@dataclass(frozen=True)
class Detections:
    """People in the network's input. xyxy: (N, 4), measured from the edge of its first pixel.

    score: (N,). xy: (N, K, 2) keypoints at pixel centres, confidence: (N, K); both None for a
    detector. best_score: of any person, where `score` holds the likely ones alone.
    """

    xyxy: FloatMatrix
    score: FloatMatrix
    xy: FloatMatrix | None = None
    confidence: FloatMatrix | None = None
    best_score: float | None = None

    @property
    def best(self) -> float:
        """The best score of any person, above the threshold or not; 0 without any."""
        return float(self.score.max(initial=0) if self.best_score is None else self.best_score)

    def select(self, rows: npt.NDArray[Any]) -> Detections:
        return Detections(
            self.xyxy[rows],
            self.score[rows],
            None if self.xy is None else self.xy[rows],
            None if self.confidence is None else self.confidence[rows],
            self.best,
        )


@dataclass(frozen=True)
class OutputForm:
    """An output form. summary: its outputs in words, for messages.

    decode: for kind pose, (outputs, manifest) -> (xy (N, K, 2), confidence (N, K)), xy in pixels
    of the network's input; for the other kinds -> Detections of the first picture of the batch.
    has_nms: the graph itself leaves one box a person.
    """

    name: str
    kind: Kind
    summary: str
    match: Callable[[Graph], Match | None]
    decode: Callable[[Outputs, Manifest], Any]
    has_nms: bool = False


def strongest(found: Detections, manifest: Manifest, *, has_nms: bool) -> Detections:
    """The people above the threshold, one box each, the surest first."""
    sure = found.score >= manifest.score_threshold
    finite = np.isfinite(found.xyxy).all(axis=1) & np.isfinite(found.score)
    found = found.select(np.flatnonzero(sure & finite))
    found = found.select(np.argsort(-found.score, kind="stable"))
    if has_nms or len(found.score) < 2:
        return found
    x, y, right, bottom = found.xyxy.T
    corner_and_size = np.stack([x, y, right - x, bottom - y], axis=1)
    kept = cv2.dnn.NMSBoxes(
        corner_and_size.tolist(), found.score.tolist(), 0.0, manifest.nms_threshold
    )
    return found.select(np.sort(np.asarray(kept, np.int64).reshape(-1)))


def only_output(graph: Graph, dimensions: int) -> TensorInfo | None:
    """The one output of a graph if it has so many axes, else None."""
    tensor = graph.outputs[0]
    return tensor if len(graph.outputs) == 1 and len(tensor.shape) == dimensions else None


def person_scores(values: Array, manifest: Manifest) -> Array:
    """(N,) scores of a person from what a head says of every class, (N, classes)."""
    person = values[:, manifest.person_class]
    if manifest.score_activation == "none":
        return person
    wide = values.astype(np.float64)
    if manifest.score_activation == "sigmoid":
        return np.asarray(1 / (1 + np.exp(-np.clip(wide[:, manifest.person_class], -60, 60))))
    share = np.exp(wide - wide.max(axis=1, keepdims=True))
    return np.asarray(share[:, manifest.person_class] / share.sum(axis=1))


def in_pixels(boxes: Array, manifest: Manifest) -> FloatMatrix:
    """Boxes (N, 4) of any format and unit as xyxy in pixels of the network's input."""
    if manifest.box_format == "yxyx":
        boxes = boxes[:, [1, 0, 3, 2]]
    elif manifest.box_format == "cxcywh":
        boxes = xyxy_from_centre(boxes)
    elif manifest.box_format == "xywh":
        boxes = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    if manifest.box_unit == "fractions":
        width, height = manifest.input_width, manifest.input_height
        boxes = boxes * np.array([width, height, width, height], np.float32)
    return boxes.astype(np.float32)


def xyxy_from_centre(boxes: Array) -> FloatMatrix:
    """Corners of boxes (N, 4) given as centre x, centre y, width, height."""
    half = boxes[:, 2:4] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1).astype(np.float32)
