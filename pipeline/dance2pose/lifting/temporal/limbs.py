"""Arms and legs that are straight as far as anybody can tell.

The bend of a limb, how far its elbow or knee lies off the line between its ends, has no sign:
errors of either direction make a straight limb look bent, never straighter than straight. The less
a bend stands out from its error, the more of it is error, and is taken back (the shrinkage of James
and Stein, 1961). A limb that is plainly bent was never straight: it stays, however unsure it is.

N frames, J joints; mm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from dance2pose.angle_formulas import flexion_of_hinge
from dance2pose.lifting.temporal.body_of_track import Joints
from dance2pose.poses import FloatArray, IntArray
from dance2pose.skeleton import Skeleton

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
# The bend, squared and in variances, that is taken back whole: errors in two directions alone
# make it 2 on average, and half of the time more.
_TAKEN_BACK = 2.5
# Limbs that seem bent by less than the first are taken for straight ones as above, those by more
# than the second never, degrees (held-out takes: shrinking all costs 0.5 degrees of every limb).
_STRAIGHT_DEG, _BENT_DEG = 25.0, 40.0
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
            flexion = np.nan_to_num(np.degrees(flexion_of_hinge(xyz[:, [a, b, c]])))
            for part in parts:
                apart[part] = _mean_nearby(apart[part], time_s[part])
                flexion[part] = _mean_nearby(flexion[part], time_s[part])
            back = np.minimum(_TAKEN_BACK / np.maximum(apart, 1e-9), 1.0)
            back *= np.clip((_BENT_DEG - flexion) / (_BENT_DEG - _STRAIGHT_DEG), 0.0, 1.0)
            xyz[:, b] -= back[:, None] * bend
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
