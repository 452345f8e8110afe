"""2D keypoints: a picture and its boxes -> poses, or with a one-stage model a picture -> both."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.detection import WholePictureModel, boxes_in_image, has_area, with_threshold
from dance2pose.errors import ModelError
from dance2pose.onnx_models.answers import Answers
from dance2pose.onnx_models.image_input import ImageInput, to_image
from dance2pose.onnx_models.inference import Array, NotFiniteError, Session
from dance2pose.onnx_models.recognition import FORMS, ModelDescription, open_model
from dance2pose.poses import Boxes, FloatArray, Image, Poses2D

# Crops a call where the graph takes any number: enough to keep the cores busy, and the memory of
# a crowded frame stays bounded.
LARGEST_BATCH = 16


@runtime_checkable
class KeypointEstimator(Protocol):
    """Finds the keypoints of people whose boxes are known."""

    description: ModelDescription
    skeleton: str
    answers: Answers

    def estimate(self, image: Image, boxes: Boxes) -> Poses2D:
        """One pose a box, in the order of the boxes; no box, no pose."""
        ...

    def describe_reading(self) -> str:
        """How the model is read, and the best score it gave so far, for a person to judge by."""
        ...


@runtime_checkable
class OneStageEstimator(Protocol):
    """Finds people and their keypoints at once."""

    description: ModelDescription
    skeleton: str
    answers: Answers

    def find(self, image: Image) -> tuple[Boxes, Poses2D]:
        """The people in a picture, the surest first, and their keypoints."""
        ...

    def describe_reading(self) -> str:
        """How the model is read, and the best score it gave so far, for a person to judge by."""
        ...


class OnnxKeypoints:
    """A top-down estimator that runs an ONNX model on a crop of every person."""

    def __init__(
        self, session: Session, description: ModelDescription, *, batch: int = LARGEST_BATCH
    ) -> None:
        self.description = description
        self.skeleton = _skeleton(description)
        manifest = description.manifest
        self.session = session
        self._decode = FORMS[description.form].decode
        image = next(tensor for tensor in session.inputs if len(tensor.shape) == 4)
        self._image_name = image.name
        self._fixed_batch = image.shape[0]
        self._batch = self._fixed_batch or min(batch, manifest.max_batch or batch)
        self._input = ImageInput(manifest, image.dtype)
        self._roles, self._outputs = zip(*description.roles.items(), strict=True)
        self.answers = Answers()

    def describe_reading(self) -> str:
        read = f"{self.description.path}: was read as {self.description.form} of {self.skeleton}"
        if self.answers.best_score is None:
            return read
        return f"{read}; the best score it gave a keypoint is {self.answers.best_score:.2g}"

    def estimate(self, image: Image, boxes: Boxes) -> Poses2D:
        """One pose a box; without keypoints where the answer is no number (see `answers`)."""
        joints = len(skeletons.get(self.skeleton))
        xy = np.full((len(boxes), joints, 2), np.nan)
        confidence = np.zeros((len(boxes), joints))
        usable = np.flatnonzero(has_area(boxes))
        try:
            for start in range(0, len(usable), self._batch):
                rows = usable[start : start + self._batch]
                xy[rows], confidence[rows] = self._crops(image, boxes.xyxy[rows], joints)
        except NotFiniteError as error:
            self.answers.note_loss(error)
            xy[:], confidence[:] = np.nan, 0
        else:
            if len(usable):
                self.answers.note(float(confidence.max()))
        return _poses(xy, confidence, self.skeleton)

    def _crops(
        self, image: Image, xyxy: FloatArray, joints: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Keypoints in the picture (N, joints, 2) and their scores for boxes (N, 4)."""
        tensor, affines = self._input.crops(image, xyxy, batch=self._fixed_batch)
        points, scores = self._run(tensor)
        people = len(xyxy)
        in_network = points[:people, :joints].astype(np.float64)
        xy = np.stack([to_image(p, a) for p, a in zip(in_network, affines, strict=True)])
        return xy, scores[:people, :joints].astype(np.float64)

    def _run(self, tensor: Array) -> tuple[Array, Array]:
        """Keypoints in the network's input and scores of a tensor of crops."""
        hint = "if it takes one picture at a time, state max_batch = 1 in its manifest"
        try:
            values = self.session.run({self._image_name: tensor}, self._outputs)
        except ModelError as error:
            if len(tensor) == 1:
                raise
            raise ModelError(f"{error}; {hint}") from error
        if len(values[0]) != len(tensor):
            raise ModelError(
                f"{self.description.path}: gave {len(values[0])} poses for {len(tensor)} crops; "
                f"{hint}"
            )
        points, scores = self._decode(
            dict(zip(self._roles, values, strict=True)), self.description.manifest
        )
        return points, scores


class OnnxOneStage(WholePictureModel):
    """A one-stage estimator that runs an ONNX model."""

    def __init__(self, session: Session, description: ModelDescription) -> None:
        super().__init__(session, description)
        self.skeleton = _skeleton(description)

    def find(self, image: Image) -> tuple[Boxes, Poses2D]:
        joints = len(skeletons.get(self.skeleton))
        try:
            found, image_from_network = self.find_in_network(image)
        except NotFiniteError as error:
            self.answers.note_loss(error)
            return Boxes(np.empty((0, 4)), np.empty(0)), _poses(
                np.empty((0, joints, 2)), np.empty((0, joints)), self.skeleton
            )
        assert found.xy is not None and found.confidence is not None
        boxes = boxes_in_image(found, image_from_network, image)
        kept = has_area(boxes)
        xy = to_image(found.xy[kept, :joints].astype(np.float64), image_from_network)
        confidence = found.confidence[kept, :joints].astype(np.float64)
        return (
            Boxes(boxes.xyxy[kept], boxes.confidence[kept]),
            _poses(xy, confidence, self.skeleton),
        )


def load_pose_model(
    path: Path,
    *,
    manifest: Path | None = None,
    threads: int | None = None,
    provider: str = "cpu",
    batch: int = LARGEST_BATCH,
    min_confidence: float | None = None,
) -> KeypointEstimator | OneStageEstimator:
    """A pose model from an ONNX file or its manifest (.toml).

    batch: people a call at most, where the graph takes any number. min_confidence: the score from
    which a one-stage model's box is a person. Raises ModelError for a model that cannot be loaded,
    is not recognised, or is a detector.
    """
    session, description = open_model(
        Path(path), manifest=manifest, threads=threads, provider=provider
    )
    if description.kind == "detector":
        raise ModelError(
            f"{path}: is a person detector ({description.form}), expected a pose model; "
            f"give it as the detector instead"
        )
    if description.kind == "one-stage":
        return OnnxOneStage(session, with_threshold(description, min_confidence))
    return OnnxKeypoints(session, description, batch=batch)


def _skeleton(description: ModelDescription) -> str:
    assert description.manifest.skeleton is not None  # Manifest checks it for pose models
    return description.manifest.skeleton


def _poses(
    xy: npt.NDArray[np.float64], confidence: npt.NDArray[np.float64], skeleton: str
) -> Poses2D:
    """Poses with the model's scores in 0..1; a keypoint with no score at all is missing."""
    missing = ~(confidence > 0) | ~np.isfinite(confidence) | ~np.isfinite(xy).all(axis=-1)
    return Poses2D(
        np.where(missing[..., None], np.nan, xy),
        np.where(missing, 0, np.clip(confidence, 0, 1)),
        skeleton,
    )
