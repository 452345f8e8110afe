"""What a dancer wears, cheaply: a colour histogram of the torso."""

from __future__ import annotations

from math import ceil, floor

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.poses import FloatArray, Image

Histogram = npt.NDArray[np.float64]

_TORSO = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
_HUES, _SATURATIONS, _VALUES = 8, 4, 4
_SMALLEST_SIDE = 4  # px; a smaller patch says nothing
_SAMPLES = 24  # pixels looked at in each direction, about


def torso_joints(skeleton: str) -> list[int]:
    """Indices of shoulders and hips in a skeleton; those it has."""
    joints = skeletons.get(skeleton).joints
    return [joints.index(name) for name in _TORSO if name in joints]


def torso_histogram(image: Image, xy: FloatArray, torso: list[int]) -> Histogram | None:
    """Colour histogram of one dancer's torso, summing to 1; None where it is not to be seen.

    xy: (J, 2) px, NaN where missing; at least three of shoulders and hips must be seen. Hue,
    saturation and brightness are binned 8 x 4 x 4.
    """
    points = xy[torso]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        return None
    height, width = image.shape[:2]
    left, top = (max(0, floor(low)) for low in points.min(axis=0).tolist())
    right, bottom = (
        min(end, ceil(high))
        for end, high in zip((width, height), points.max(axis=0).tolist(), strict=True)
    )
    if right - left < _SMALLEST_SIDE or bottom - top < _SMALLEST_SIDE:
        return None
    # Some hundred pixels tell the colours as well as all of them.
    rows, columns = (max(1, n // _SAMPLES) for n in (bottom - top, right - left))
    sample = np.ascontiguousarray(image[top:bottom:rows, left:right:columns])
    patch = cv2.cvtColor(sample, cv2.COLOR_BGR2HSV)
    counts = cv2.calcHist(
        [patch],
        [0, 1, 2],
        None,
        [_HUES, _SATURATIONS, _VALUES],
        [0, 180, 0, 256, 0, 256],
    )
    histogram: Histogram = counts.ravel().astype(np.float64)
    histogram /= histogram.sum()
    return histogram


def likeness(first: Histogram, second: Histogram) -> float:
    """Bhattacharyya coefficient of two histograms: 1 the same, 0 nothing in common."""
    return float(np.sqrt(first * second).sum())
