"""How alike a track and a detection are: motion, boxes, keypoints, appearance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dance2pose.poses import FloatArray

Float64Array = npt.NDArray[np.float64]

# Deviation of a keypoint that still counts as alike, in units of the root of the box area. COCO's
# per-joint constants (0.025-0.107) compare two annotations of one picture. Between two pictures a
# limb also moves, so that one wide constant serves better.
SAME_PICTURE_SIGMA = 0.08
NEXT_PICTURE_SIGMA = 0.15

# How agile a body is, in body sizes: the spectral density of its acceleration is (this * size)^2,
# so that within a second the velocity wanders by about this many sizes per second.
_AGILITY = 4.0
# Deviation of a detector's box centre from frame to frame, in body sizes.
_BOX_NOISE = 0.05
# Deviation of the unknown velocity of a new track, sizes per second.
_FIRST_SPEED = 3.0
# Out of sight, a movement dies down with this time constant: nobody runs straight on for long.
_VELOCITY_DECAY_S = 2.0


class BoxMotion:
    """Kalman filter with nearly constant velocity for the centre of a box; its size changes slowly.

    Time is in seconds, so any and varying frame rates fit.
    """

    def __init__(self, xyxy: Float64Array) -> None:
        self.size = box_sizes(xyxy[np.newaxis])[0]
        self.extent = xyxy[2:] - xyxy[:2]
        # Rows: centre (x, y) px, velocity (x, y) px/s. Both coordinates share the covariance.
        self.state = np.array([(xyxy[:2] + xyxy[2:]) / 2, np.zeros(2)])
        self.covariance = np.diag([(_BOX_NOISE * self.size) ** 2, (_FIRST_SPEED * self.size) ** 2])

    def advance(self, step_s: float) -> None:
        """Move on by `step_s` seconds without a sight."""
        kept = np.exp(-step_s / _VELOCITY_DECAY_S)
        transition = np.array([[1.0, _VELOCITY_DECAY_S * (1 - kept)], [0.0, kept]])
        wander = np.array([[step_s**3 / 3, step_s**2 / 2], [step_s**2 / 2, step_s]])
        self.state = transition @ self.state
        self.covariance = transition @ self.covariance @ transition.T
        self.covariance += (_AGILITY * self.size) ** 2 * wander

    def correct(self, xyxy: Float64Array) -> None:
        """Take in a sight at the present time."""
        noise = (_BOX_NOISE * self.size) ** 2
        gain = self.covariance[:, :1] / (self.covariance[0, 0] + noise)
        centre = (xyxy[:2] + xyxy[2:]) / 2
        self.state = self.state + gain @ (centre - self.state[0])[np.newaxis]
        self.covariance = self.covariance - gain @ self.covariance[:1]
        self.extent += 0.5 * (xyxy[2:] - xyxy[:2] - self.extent)
        self.size += 0.5 * (box_sizes(xyxy[np.newaxis])[0] - self.size)

    @property
    def xyxy(self) -> Float64Array:
        """The box where it is expected now."""
        return np.concatenate([self.state[0] - self.extent / 2, self.state[0] + self.extent / 2])

    def deviations(self, xyxy: Float64Array) -> Float64Array:
        """Distance of the centres of boxes (N, 4) from here, in standard deviations (N,)."""
        centres = (xyxy[:, :2] + xyxy[:, 2:]) / 2
        variance = self.covariance[0, 0] + (_BOX_NOISE * self.size) ** 2
        x, y = (centres - self.state[0]).T
        away: Float64Array = np.hypot(x, y) / np.sqrt(variance)
        return away


def box_sizes(xyxy: FloatArray) -> Float64Array:
    """Roots of the areas of boxes (..., 4), px; at least 1."""
    sides = np.maximum(xyxy[..., 2:] - xyxy[..., :2], 1.0)
    sizes: Float64Array = np.sqrt(sides[..., 0] * sides[..., 1]).astype(np.float64)
    return sizes


def box_overlaps(first: FloatArray, second: FloatArray) -> Float64Array:
    """Intersection over union of boxes (M, 4) and (N, 4): (M, N) in 0..1."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    shared = _areas(low, high)
    areas = [_areas(boxes[:, :2], boxes[:, 2:]) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None, :] - shared
    overlap: Float64Array = shared / np.maximum(union, 1e-9)
    return overlap


def _areas(low: FloatArray, high: FloatArray) -> FloatArray:
    sides = np.maximum(high - low, 0)
    return np.asarray(sides[..., 0] * sides[..., 1])


def keypoint_similarities(
    first: FloatArray, second: FloatArray, sizes: FloatArray, *, sigma: float
) -> Float64Array:
    """Mean likeness of the keypoints that both poses show (object keypoint similarity, COCO).

    first: (M, J, 2); second: (N, J, 2); NaN where missing. sizes: (M,) px, scale of the first
    poses. Returns (M, N) in 0..1, NaN where no keypoint is shared.
    """
    apart = np.square(first[:, None] - second[None])
    away = apart[..., 0] + apart[..., 1]
    alike = np.exp(away / (-2 * np.square(sigma * sizes)[:, None, None]))
    shared = np.isfinite(alike)
    count = shared.sum(axis=2)
    total = alike.sum(axis=2, where=shared)
    similarity: Float64Array = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return similarity


def duplicates(
    xy: FloatArray, xyxy: FloatArray, strength: FloatArray, *, threshold: float
) -> npt.NDArray[np.bool_]:
    """Which of N detections repeat a stronger one of the same person (non-maximum suppression).

    Two are the same where their keypoints agree (similarity of at least `threshold`); people
    who overlap differ in their keypoints. xy: (N, J, 2); xyxy: (N, 4); strength: (N,).
    """
    sizes = box_sizes(xyxy)
    similarity = keypoint_similarities(xy, xy, sizes, sigma=SAME_PICTURE_SIGMA)
    similarity = np.fmax(similarity, similarity.T)
    repeated = np.zeros(len(xy), np.bool_)
    order = np.argsort(-strength, kind="stable")
    for place, i in enumerate(order):
        if not repeated[i]:
            weaker = order[place + 1 :]
            repeated[weaker] |= np.nan_to_num(similarity[i, weaker]) >= threshold
    return repeated
