"""Arms and legs that are straight as far as anybody can tell.

The bend of a limb, how far its elbow or knee lies off the line between its ends, has no sign:
errors of either direction make a straight limb look bent, never straighter than straight. On
average they add their variance to the square of the bend: so much is taken from it.

N frames, J joints; mm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from dance2pose.lifting.temporal.body_of_track import Joints
from dance2pose.poses import FloatArray, IntArray
from dance2pose.skeleton import Skeleton

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
# A bend errs in the two directions across its line.
_DIRECTIONS = 2
# Where the network does not know a pose at all, nothing speaks for straight limbs either: a larger
# error than this is not believed to have made a bend, mm.
_LARGEST_ERROR_MM = 60.0
# Limbs do not become straight and bent again within this time.
_LASTING_S = 0.12


def straightened(
    joints: Joints, tree: Skeleton, time_s: FloatArray, parts: Sequence[IntArray]
) -> Joints:
    """The same with elbows and knees nearer to the line between the ends of their limbs.

    time_s: (N,). parts: rows that follow each other in time.
    """
    xyz = joints.xyz.copy()
    variance = np.square(np.minimum(joints.sigma, _LARGEST_ERROR_MM))
    for side in ("left", "right"):
        for limb in _LIMBS:
            a, b, c = (tree.index(f"{side}_{joint}") for joint in limb)
            bend = _bend(xyz[:, a], xyz[:, b], xyz[:, c])
            # The line moves with its ends, by half of what each moves where the joint is.
            error = variance[:, b] + (variance[:, a] + variance[:, c]) / 4
            apart = (np.square(bend) / error).sum(axis=1)
            for part in parts:
                apart[part] = _mean_nearby(apart[part], time_s[part])
            left = np.sqrt(np.maximum(1 - _DIRECTIONS / np.maximum(apart, 1e-9), 0.0))
            xyz[:, b] -= (1 - left)[:, None] * bend
    return Joints(xyz, joints.sigma)


def _bend(start: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    """How far (N, 3) the middle lies off the line from start to end."""
    chord, upper = end - start, middle - start
    along = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1.0)
    return np.asarray(upper - (upper * along).sum(axis=1, keepdims=True) * along)


def _mean_nearby(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """The mean (T,) over frames about as close as _LASTING_S."""
    if len(values) < 3:
        return values
    frames = max(1, round(_LASTING_S / float(np.median(np.diff(time_s)))))
    return np.asarray(uniform_filter1d(values, frames, mode="nearest"))
