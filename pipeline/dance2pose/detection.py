"""Person detection: a picture -> boxes."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from dance2pose.errors import ModelError
from dance2pose.onnx_models.forms import Detections, extra_feeds, strongest
from dance2pose.onnx_models.image_input import Affine, ImageInput, to_image
from dance2pose.onnx_models.inference import Session
from dance2pose.onnx_models.recognition import FORMS, ModelDescription, open_model
from dance2pose.poses import Boxes, Image


@runtime_checkable
class Detector(Protocol):
    """Finds people in pictures."""

    description: ModelDescription

    def detect(self, image: Image) -> Boxes:
        """The people in a BGR picture (H, W, 3), the surest first; none is an empty Boxes."""
        ...


class WholePictureModel:
    """A model that looks at the whole picture: a detector or a one-stage pose model."""

    def __init__(self, session: Session, description: ModelDescription) -> None:
        self.description = description
        manifest = description.manifest
        self._session = session
        self._form = FORMS[description.form]
        image = next(tensor for tensor in session.inputs if len(tensor.shape) == 4)
        self._image_name = image.name
        self._batch = image.shape[0] or 1
        self._input = ImageInput(manifest, image.dtype)
        self._extra = extra_feeds(session, manifest.input_width, manifest.input_height)
        self._roles, self._outputs = zip(*description.roles.items(), strict=True)

    def find_in_network(self, image: Image) -> tuple[Detections, Affine]:
        """People in the network's input, the surest first, and image_from_network (2, 3)."""
        manifest = self.description.manifest
        tensor, image_from_network = self._input.whole(image, batch=self._batch)
        values = self._session.run({self._image_name: tensor, **self._extra}, self._outputs)
        found = self._form.decode(dict(zip(self._roles, values, strict=True)), manifest)
        return strongest(found, manifest, has_nms=self._form.has_nms), image_from_network


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
        found, image_from_network = self.find_in_network(image)
        boxes = boxes_in_image(found, image_from_network, image)
        kept = has_area(boxes)
        return Boxes(boxes.xyxy[kept], boxes.confidence[kept])


def load_detector(
    path: Path, *, manifest: Path | None = None, threads: int | None = None
) -> Detector:
    """A detector from an ONNX file or its manifest (.toml).

    Raises ModelError for a model that cannot be loaded, is not recognised, or is no detector.
    """
    session, description = open_model(Path(path), manifest=manifest, threads=threads)
    if description.kind != "detector":
        hint = " (it needs no detector)" if description.kind == "one-stage" else ""
        raise ModelError(
            f"{path}: is a {description.kind} model ({description.form}, {description.keypoints} "
            f"keypoints), expected a person detector; give it as the pose model instead{hint}"
        )
    return OnnxDetector(session, description)
