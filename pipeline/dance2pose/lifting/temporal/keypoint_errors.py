"""How far keypoints are from the joints, told by the track itself.

Errors that change from frame to frame show as jitter. Those that last, as keypoint models make them
for as long as a pose and a costume look alike, no jitter tells and no average mends; but they make
bones look longer and shorter than they are, most plainly where a bone lies across the view.

N frames, J joints, B bones; mm at the size of the dancer.
"""

from __future__ import annotations

import numpy as np

from dance2pose.lifting.temporal.smoothness import frame_noise
from dance2pose.poses import FloatArray

_LEAST_NOISE_MM = 1.0
# Of the variance that the network expects for the depths of a bone's two ends: they err together.
_DEPTH_VARIANCE = 0.3
# Bones whose depth makes their length uncertain by more than this tell little; longer errors are of
# another kind (sides confused, a joint taken for another).
_TELLING_MM, _MOST_MM = 5.0, 80.0
# A bone that looks longer than this, beside the median of the dancer's bones, was not seen rightly.
_TOO_LONG = 1.25


def jitter(picture: FloatArray, confidence: FloatArray) -> FloatArray:
    """Standard deviation (N, J) of what changes from frame to frame of (N, J, 2)."""
    noise = np.maximum(np.nan_to_num(frame_noise(picture)), _LEAST_NOISE_MM)
    return np.asarray(noise / np.clip(confidence, 0.1, 1.0))


def of_lengths(bone: FloatArray, depth_variance: FloatArray, lengths: FloatArray) -> float:
    """Standard deviation of keypoints in either direction of the picture, from how much bones
    (N, B, 3) with depths of known error seem to differ from their lengths (B,).

    Bones count by how well their length is known but for the keypoints' errors: those that lie
    across the view. NaN bones do not count; 0 where nothing is told.
    """
    across2, depth2 = np.square(bone[..., :2]).sum(axis=-1), np.square(bone[..., 2])
    variance = _DEPTH_VARIANCE * depth_variance
    seeming = np.sqrt(across2 + depth2)
    by_depth = (depth2 * variance + variance**2 / 2) / np.maximum(seeming, 30.0) ** 2
    weight = 1 / (by_depth + _TELLING_MM**2) ** 2
    off = np.minimum(np.square(seeming - lengths), _MOST_MM**2) - by_depth
    known = np.isfinite(off)
    # Both ends err, each across the bone and along it; only along it does the length change.
    told = float((2 * weight * across2 / lengths**2)[known].sum())
    total = float((weight * off)[known].sum())
    return float(np.sqrt(max(total, 0.0) / told)) if told > 0 else 0.0


def likely_projections(longest: FloatArray, body_mm: FloatArray) -> FloatArray:
    """Longest projections (J - 1,) without those that no body of this size could have.

    A keypoint that is wrong for much of a track makes its bones look far too long, and the dancer
    with them; such a bone gets the length that the others let expect. NaN stays.
    """
    ratio = longest / body_mm
    if not np.isfinite(ratio).any():
        return longest
    typical = np.nanmedian(ratio)
    return np.asarray(np.where(ratio > _TOO_LONG * typical, typical * body_mm, longest))
