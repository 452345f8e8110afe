"""Arms and legs that are straight as far as anybody can tell.

The bend of a limb, how far its elbow or knee lies off the line between its ends, has no sign:
errors of either direction make a straight limb look bent, never straighter than straight. The less
a bend stands out from its error, the more of it is error, and is taken back (the shrinkage of James
and Stein, 1961).

N frames, J joints; mm.
"""

from __future__ import annotations

import numpy as np

from dance2pose.lifting.temporal.body_of_track import Joints
from dance2pose.skeleton import Skeleton

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
# The bend, squared and in variances, that is taken back whole: errors in two directions alone
# make it 2 on average.
_TAKEN_BACK = 2.0


def straightened(joints: Joints, tree: Skeleton) -> Joints:
    """The same with elbows and knees nearer to the line between the ends of their limbs."""
    xyz, variance = joints.xyz.copy(), np.square(joints.sigma)
    for side in ("left", "right"):
        for limb in _LIMBS:
            a, b, c = (tree.index(f"{side}_{joint}") for joint in limb)
            chord = xyz[:, c] - xyz[:, a]
            along = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1.0)
            upper = xyz[:, b] - xyz[:, a]
            bend = upper - (upper * along).sum(axis=1, keepdims=True) * along
            # The line moves with its ends, by half of what each moves where the joint is.
            error = variance[:, b] + (variance[:, a] + variance[:, c]) / 4
            apart = np.square(bend) / error
            back = np.minimum(_TAKEN_BACK / np.maximum(apart.sum(axis=1), 1e-9), 1.0)
            xyz[:, b] -= back[:, None] * bend
    return Joints(xyz, joints.sigma)
