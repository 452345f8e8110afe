"""From a picture to the tensor a model wants, written once and driven by the manifest.

Coordinates are those of `dance2pose.poses`: pixel centres, the top-left one at (0, 0), in the
picture and in the network's input alike. Each tensor comes with `image_from_network`, the (2, 3)
affine that takes points of the network's input to points of the picture.
"""

from __future__ import annotations

import threading
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose.onnx_models.manifest import Manifest
from dance2pose.poses import FloatArray, Image

Affine = npt.NDArray[np.float64]

# Pictures no larger than this are converted to four channels: those of video tape are.
_MOST_CONVERTED_PX = 720 * 576


class ImageInput:
    """Prepares pictures for one model. dtype: of the model's image input.

    The tensors it gives are one buffer a thread, used again at that thread's next call: fresh
    memory for every frame costs as much as filling it.
    """

    def __init__(self, manifest: Manifest, dtype: np.dtype[Any]) -> None:
        self.manifest = manifest
        self.dtype = dtype
        self._scale = 1 / np.asarray(manifest.std, np.float32)
        self._offset = -np.asarray(manifest.mean, np.float32) * self._scale
        self._of_thread = threading.local()

    def whole(self, image: Image, *, batch: int = 1) -> tuple[npt.NDArray[Any], Affine]:
        """The whole picture as the first of a tensor of `batch`, and image_from_network (2, 3)."""
        if self.manifest.resize == "stretch":
            picture, affine = _stretched(image, self.manifest)
        else:
            picture, affine = _letterboxed(image, self.manifest)
        tensor = self._tensor(batch)
        self._fill(tensor[0], picture)
        return tensor, affine

    def crops(
        self, image: Image, boxes_xyxy: FloatArray, *, batch: int | None = None
    ) -> tuple[npt.NDArray[Any], npt.NDArray[np.float64]]:
        """One crop a box: a tensor of N pictures and image_from_network (N, 2, 3).

        batch: length of the tensor, at least N; what lies behind the crops means nothing.
        """
        size = (self.manifest.input_width, self.manifest.input_height)
        affines = crop_affines(boxes_xyxy, size, self.manifest.box_scale)
        tensor = self._tensor(batch or len(boxes_xyxy))
        image = self._four_channels(image)
        for slot, affine in zip(tensor, affines, strict=False):
            picture = cv2.warpAffine(
                image, affine, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            )
            self._fill(slot, np.asarray(picture, np.uint8))
        return tensor, affines

    def _four_channels(self, image: Image) -> Image:
        """The picture as BGRA, which OpenCV warps in a third of the time of three channels, to the
        same values. A large one is left as it is: to convert it takes longer than that saves."""
        height, width = image.shape[:2]
        if height * width > _MOST_CONVERTED_PX:
            return image
        buffer: Image | None = getattr(self._of_thread, "bgra", None)
        if buffer is None or buffer.shape[:2] != (height, width):
            buffer = self._of_thread.bgra = np.empty((height, width, 4), np.uint8)
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2BGRA, dst=buffer), np.uint8)

    def _tensor(self, count: int) -> npt.NDArray[Any]:
        buffer: npt.NDArray[Any] | None = getattr(self._of_thread, "buffer", None)
        if buffer is None or len(buffer) < count:
            buffer = self._of_thread.buffer = self._empty(count)
        return buffer[:count]

    def _empty(self, count: int) -> npt.NDArray[Any]:
        sides = (self.manifest.input_height, self.manifest.input_width)
        shape = (3, *sides) if self.manifest.layout == "NCHW" else (*sides, 3)
        return np.zeros((count, *shape), self.dtype)

    def _fill(self, slot: npt.NDArray[Any], picture: Image) -> None:
        """Write a BGR(A) picture of the network's size into one slot of a tensor, normalised."""
        planes = cv2.split(picture)[:3]
        if self.manifest.colour_order == "RGB":
            planes = planes[::-1]
        for channel, plane in enumerate(planes):
            target = slot[channel] if self.manifest.layout == "NCHW" else slot[..., channel]
            scale, offset = self._scale[channel], self._offset[channel]
            if scale == 1 and offset == 0:
                target[...] = plane
            elif self.dtype == np.float32:
                np.multiply(plane, scale, out=target, dtype=np.float32)
                target += offset
            else:
                target[...] = plane * scale + offset


def crop_affines(
    boxes_xyxy: FloatArray, size: tuple[int, int], box_scale: float
) -> npt.NDArray[np.float64]:
    """image_from_network (N, 2, 3) of crops about boxes, widened to the aspect of `size`.

    boxes_xyxy: (N, 4) px. size: (width, height) of the network's input. The box, made larger on
    one axis until it has the aspect of `size` and then by `box_scale`, fills the input.
    """
    boxes = np.asarray(boxes_xyxy, np.float64)
    width, height = size
    centre = (boxes[:, :2] + boxes[:, 2:]) / 2
    extent = boxes[:, 2:] - boxes[:, :2]
    scale = box_scale * np.maximum(extent[:, 0] / width, extent[:, 1] / height)
    affines = np.zeros((len(boxes), 2, 3))
    affines[:, 0, 0] = affines[:, 1, 1] = scale
    affines[:, :, 2] = centre - scale[:, None] * (np.array([width, height]) - 1) / 2
    return affines


def to_image(points: FloatArray, image_from_network: Affine) -> npt.NDArray[np.float64]:
    """Points (..., 2) of the network's input as points of the picture."""
    matrix = image_from_network
    return np.asarray(points @ matrix[:, :2].T + matrix[:, 2])


def _stretched(image: Image, manifest: Manifest) -> tuple[Image, Affine]:
    height, width = image.shape[:2]
    size = (manifest.input_width, manifest.input_height)
    picture = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    return picture, _resize_affine((width, height), size, (0, 0))


def _letterboxed(image: Image, manifest: Manifest) -> tuple[Image, Affine]:
    height, width = image.shape[:2]
    ratio = min(manifest.input_width / width, manifest.input_height / height)
    inner = (max(1, round(width * ratio)), max(1, round(height * ratio)))
    left = top = 0
    if manifest.padding_position == "centre":
        left = (manifest.input_width - inner[0]) // 2
        top = (manifest.input_height - inner[1]) // 2
    shape = (manifest.input_height, manifest.input_width, 3)
    picture = np.full(shape, manifest.padding_value, np.uint8)
    picture[top : top + inner[1], left : left + inner[0]] = cv2.resize(
        image, inner, interpolation=cv2.INTER_LINEAR
    )
    return picture, _resize_affine((width, height), inner, (left, top))


def _resize_affine(
    image_size: tuple[int, int], inner: tuple[int, int], shift: tuple[int, int]
) -> Affine:
    """image_from_network of a resize to `inner` px placed at `shift`.

    Resizing keeps the picture's edges, which lie half a pixel outside the outer pixel centres.
    """
    scale = np.array(image_size) / np.array(inner)
    offset = (0.5 - np.array(shift)) * scale - 0.5
    return np.array([[scale[0], 0, offset[0]], [0, scale[1], offset[1]]])
