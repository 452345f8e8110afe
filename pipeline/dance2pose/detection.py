"""Person detection: a picture -> boxes."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from dance2pose.errors import ModelError
from dance2pose.onnx_models.answers import Answers
from dance2pose.onnx_models.forms import Detections, extra_feeds, strongest
from dance2pose.onnx_models.image_input import Affine, ImageInput, to_image
from dance2pose.onnx_models.inference import NotFiniteError, Session
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.recognition import FORMS, ModelDescription, open_model
from dance2pose.poses import Boxes, Image


@runtime_checkable
class Detector(Protocol):
    """Finds people in pictures."""

    description: ModelDescription
    answers: Answers

    def detect(self, image: Image) -> Boxes:
        """The people in a BGR picture (H, W, 3), the surest first; none is an empty Boxes."""
        ...

    def describe_reading(self) -> str:
        """How the model is read, and the best score it gave so far, for a person to judge by."""
        ...


# Scores are 0 to 1; half precision and quantised models go a little beyond, which is clipped.
_LEAST_SCORE, _MOST_SCORE = -0.5, 1.5


class WholePictureModel:
    """A model that looks at the whole picture: a detector or a one-stage pose model."""

    def __init__(self, session: Session, description: ModelDescription) -> None:
        self.description = description
        manifest = description.manifest
        self.session = session
        self._form = FORMS[description.form]
        image = next(tensor for tensor in session.inputs if len(tensor.shape) == 4)
        self._image_name = image.name
        self._batch = image.shape[0] or 1
        self._input = ImageInput(manifest, image.dtype)
        self._extra = extra_feeds(session, manifest.input_width, manifest.input_height)
        self._roles, self._outputs = zip(*description.roles.items(), strict=True)
        self.answers = Answers()

    def find_in_network(self, image: Image) -> tuple[Detections, Affine]:
        """People in the network's input, the surest first, and image_from_network (2, 3).

        Raises NotFiniteError where the answer to this picture is none, ModelError where the model
        is not what it was read as.
        """
        manifest = self.description.manifest
        tensor, image_from_network = self._input.whole(image, batch=self._batch)
        values = self.session.run({self._image_name: tensor, **self._extra}, self._outputs)
        try:
            found = self._form.decode(dict(zip(self._roles, values, strict=True)), manifest)
        except (ValueError, IndexError) as error:
            raise ModelError(f"{self._read_as()}, but {error}; {_SAY}") from error
        self._check(found)
        self.answers.note(found.best)
        return strongest(found, manifest, has_nms=self._form.has_nms), image_from_network

    def describe_reading(self) -> str:
        manifest = self.description.manifest
        person = "" if manifest.kind != "detector" else f", a person being class {_class(manifest)}"
        if self.answers.best_score is None:
            return f"{self._read_as()}{person}"
        return (
            f"{self._read_as()}{person}; the best score it gave a person is "
            f"{self.answers.best_score:.2g}, and from {manifest.score_threshold:g} on they count"
        )

    def _read_as(self) -> str:
        return f"{self.description.path}: was read as {self.description.form}"

    def _check(self, found: Detections) -> None:
        """Scores must be scores, and what is sure must be somewhere."""
        if not found.score.size:
            return
        is_bad = ~(np.isfinite(found.xyxy).all(axis=1) & np.isfinite(found.score))
        sure = ~(found.score < self.description.manifest.score_threshold)
        if sure.any() and is_bad[sure].all():
            raise NotFiniteError(
                f"{self.description.path}: gave boxes or scores that are not finite numbers"
            )
        finite = found.score[np.isfinite(found.score)]
        low, high = finite.min(initial=0), finite.max(initial=0)
        if low < _LEAST_SCORE or high > _MOST_SCORE:
            raise ModelError(
                f"{self._read_as()}, but gives {low if low < _LEAST_SCORE else high:.4g} as a "
                f"score, which lies in 0 to 1; {_SAY}"
            )


_SAY = "say in a manifest what it gives (`dance2pose models inspect MODEL --write`)"


def _class(manifest: Manifest) -> str:
    return f"{manifest.person_class} (counted from 0)"


def boxes_in_image(found: Detections, image_from_network: Affine, image: Image) -> Boxes:
    """Boxes in the picture, cut at its border; one that lies outside of it becomes empty."""
    # Detectors measure boxes from the edge of the first pixel, the project from its centre.
    corners = found.xyxy.reshape(-1, 2, 2).astype(np.float64) - 0.5
    xy = to_image(corners, image_from_network)
    height, width = image.shape[:2]
    xy = np.clip(xy, -0.5, np.array([width, height]) - 0.5)
    return Boxes(xy.reshape(-1, 4), np.clip(found.score.astype(np.float64), 0, 1))


def has_area(boxes: Boxes) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(N,) True where a box is at least a pixel wide and high."""
    extent = boxes.xyxy[:, 2:] - boxes.xyxy[:, :2]
    return np.asarray((extent >= 1).all(axis=1))


class OnnxDetector(WholePictureModel):
    """A person detector that runs an ONNX model."""

    def detect(self, image: Image) -> Boxes:
        """The people in a picture; nobody where the answer is no number (see `answers`)."""
        try:
            found, image_from_network = self.find_in_network(image)
        except NotFiniteError as error:
            self.answers.note_loss(error)
            return Boxes(np.empty((0, 4)), np.empty(0))
        boxes = boxes_in_image(found, image_from_network, image)
        kept = has_area(boxes)
        return Boxes(boxes.xyxy[kept], boxes.confidence[kept])


def load_detector(
    path: Path,
    *,
    manifest: Path | None = None,
    threads: int | None = None,
    provider: str = "cpu",
    min_confidence: float | None = None,
) -> Detector:
    """A detector from an ONNX file or its manifest (.toml).

    min_confidence: the score from which a box is a person, where not as its manifest or its family
    has it. Raises ModelError for a model that cannot be loaded, is not recognised, or is no
    detector.
    """
    session, description = open_model(
        Path(path), manifest=manifest, threads=threads, provider=provider
    )
    if description.kind != "detector":
        hint = " (it needs no detector)" if description.kind == "one-stage" else ""
        raise ModelError(
            f"{path}: is a {description.kind} model ({description.form}, {description.keypoints} "
            f"keypoints), expected a person detector; give it as the pose model instead{hint}"
        )
    return OnnxDetector(session, with_threshold(description, min_confidence))


def with_threshold(description: ModelDescription, min_confidence: float | None) -> ModelDescription:
    """The description with another score from which a box is a person; None changes nothing."""
    if min_confidence is None:
        return description
    manifest = dataclasses.replace(description.manifest, score_threshold=min_confidence)
    return dataclasses.replace(description, manifest=manifest)
