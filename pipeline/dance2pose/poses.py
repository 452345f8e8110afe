"""The data that flows between the stages: frozen dataclasses over NumPy arrays.

T frames, N people, J joints or keypoints. Missing is NaN, never 0 and never a guess. Time is the
frame's own presentation timestamp in seconds. Image axes: x right, y down, pixels, the centre of
the top-left pixel at (0, 0). Camera axes: x right, y down, z forward. World axes: x right, y up,
z towards the viewer (right-handed).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]

Unit = Literal["body heights", "metres"]


def _require_shape(name: str, array: npt.NDArray[Any], shape: tuple[int | None, ...]) -> None:
    """Raise ValueError unless `array` has `shape`; None matches any length."""
    matches = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not matches:
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name} has shape {array.shape}, expected {wanted}")


@dataclass(frozen=True)
class Frame:
    """One decoded picture.

    index: number of the frame in the file, counted in presentation order from 0.
    time_s: presentation timestamp in seconds from the start of the video.
    image: (H, W, 3) uint8 BGR, upright, square pixels, progressive.
    """

    index: int
    time_s: float
    image: Image

    def __post_init__(self) -> None:
        _require_shape("image", self.image, (None, None, 3))
        if self.image.dtype != np.uint8:
            raise ValueError(f"image has dtype {self.image.dtype}, expected uint8")


@dataclass(frozen=True)
class Boxes:
    """People found in one frame. xyxy: (N, 4) px; confidence: (N,) in 0..1."""

    xyxy: FloatArray
    confidence: FloatArray

    def __post_init__(self) -> None:
        _require_shape("xyxy", self.xyxy, (None, 4))
        _require_shape("confidence", self.confidence, (len(self.xyxy),))

    def __len__(self) -> int:
        return len(self.xyxy)


@dataclass(frozen=True)
class Poses2D:
    """The keypoints of N people in one frame.

    xy: (N, J, 2) px, NaN where missing. confidence: (N, J), the model's own score (not
    comparable between models), 0 where xy is NaN. skeleton: a name of `dance2pose.skeleton`.
    """

    xy: FloatArray
    confidence: FloatArray
    skeleton: str

    def __post_init__(self) -> None:
        _require_shape("xy", self.xy, (None, None, 2))
        _require_shape("confidence", self.confidence, self.xy.shape[:2])

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True)
class Track2D:
    """One dancer's keypoints over time.

    person: number of the dancer from 1. frame: (T,) int64, strictly increasing frame indices;
    every processed frame between the first and last sight of the dancer is a row.
    time_s: (T,) float64. xy: (T, J, 2) px, NaN where missing. confidence: (T, J), 0 where
    missing. interpolated: (T,) True where the pose was filled in across a short gap.
    box: (T, 4) xyxy px, NaN where not detected. shot: number of the shot the track belongs to,
    from 0. image_size: (width, height) px of the upright, square-pixel picture.
    """

    person: int
    frame: IntArray
    time_s: npt.NDArray[np.float64]
    xy: FloatArray
    confidence: FloatArray
    skeleton: str
    interpolated: BoolArray
    box: FloatArray
    image_size: tuple[int, int]
    shot: int = 0

    def __post_init__(self) -> None:
        length = len(self.frame)
        _require_shape("frame", self.frame, (None,))
        _require_shape("time_s", self.time_s, (length,))
        _require_shape("xy", self.xy, (length, None, 2))
        _require_shape("confidence", self.confidence, (length, self.xy.shape[1]))
        _require_shape("interpolated", self.interpolated, (length,))
        _require_shape("box", self.box, (length, 4))

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True)
class Track3D:
    """One dancer's joints over time.

    frame, time_s: as in Track2D. xyz: (T, J, 3) in world axes, the first joint (pelvis) at the
    origin, NaN where nothing is known. unit: of xyz. reprojection_error: (T, J) px, NaN where no
    keypoint was seen. valid: (T, J - 1) bool, one flag a bone (bone b ends at joint b + 1),
    False where the bone breaks a joint-angle limit. estimated: (T, J) True where the joint was
    not seen and comes from the body model alone. sigma: (T, J) standard deviation of the
    position in `unit`, or None where the lifter does not know. root: (T, 3) position of the
    first joint in the world, in `unit`, or None where it is not known.
    """

    person: int
    frame: IntArray
    time_s: npt.NDArray[np.float64]
    xyz: FloatArray
    unit: Unit
    skeleton: str
    reprojection_error: FloatArray
    valid: BoolArray
    estimated: BoolArray
    sigma: FloatArray | None = None
    root: FloatArray | None = None

    def __post_init__(self) -> None:
        length = len(self.frame)
        _require_shape("frame", self.frame, (None,))
        _require_shape("time_s", self.time_s, (length,))
        _require_shape("xyz", self.xyz, (length, None, 3))
        joints = self.xyz.shape[1]
        _require_shape("reprojection_error", self.reprojection_error, (length, joints))
        _require_shape("valid", self.valid, (length, joints - 1))
        _require_shape("estimated", self.estimated, (length, joints))
        if self.sigma is not None:
            _require_shape("sigma", self.sigma, (length, joints))
        if self.root is not None:
            _require_shape("root", self.root, (length, 3))

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True)
class Dancer:
    """All that is known of one dancer: keypoints, the lifted poses, and the same smoothed.

    The three share `person`, `frame` and `time_s`.
    """

    track: Track2D
    raw: Track3D
    smoothed: Track3D

    @property
    def person(self) -> int:
        return self.track.person
