"""Bodies: bone lengths, the one body that poses are learned on, and retargeting.

Lengths in mm; bone b of a lifting skeleton ends at joint b + 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton, get

# Bone lengths of the one body, mm, in the order of cmu17's bones: the body that the CMU actions
# corpus is given on, its left and right sides made equal.
BODY_BONES_MM: FloatArray = np.array(
    [232.7, *(204.7, 279.1, 189.7) * 2, 175.0, *(141.7, 428.4, 409.3, 125.8) * 2]
)
# From sole to crown when that body stands: its ankles are 0.94 m below the root, the soles about
# 0.08 m lower; the base of the skull is 0.41 m above it, the crown about 0.22 m higher.
BODY_HEIGHT_MM = 1650.0

# body17 has a body of its own of the same height, because cmu17's is not what keypoint models
# see: the BVH rig has no thorax (about 105 mm of trunk) and ends the forearm a third early.
# Fractions of height after the segment lengths of Drillis and Contini (in Winter, Biomechanics
# and Motor Control of Human Movement): hips at 0.530, shoulders at 0.818 (hence the trunk), ears
# at 0.93, upper arm 0.186, forearm 0.146, thigh 0.245, shin 0.246. Shoulders and hips are half
# the distance between joint centres, which is narrower than the body; toe is ankle to big toe.
_BODY17_FRACTIONS = np.array(
    [0.288, *(0.110, 0.180, 0.146) * 2, 0.112, *(0.056, 0.245, 0.246, 0.115) * 2]
)
BODY17_BONES_MM: FloatArray = _BODY17_FRACTIONS * BODY_HEIGHT_MM


@dataclass(frozen=True)
class Body:
    """The bone lengths of one dancer.

    lengths_mm: (J - 1,) of a lifting skeleton, scaled to the sum that the one body's have: one
    camera does not tell sizes. spread: (J - 1,) standard deviation of each, as a part of it.
    """

    skeleton: str
    lengths_mm: FloatArray
    spread: FloatArray


def body_bones_mm(skeleton: str) -> FloatArray:
    """Bone lengths (J - 1,) mm of the one body in a lifting skeleton."""
    if skeleton == "cmu17":
        return BODY_BONES_MM.copy()
    if skeleton == "body17":
        return BODY17_BONES_MM.copy()
    if skeleton == "paper15":  # cmu17's bones, by the joint they end at, without the toes
        cmu = get("cmu17")
        names = ["upper_back" if name == "neck" else name for name in get(skeleton).joints[1:]]
        lengths: FloatArray = BODY_BONES_MM[[cmu.index(name) - 1 for name in names]]
        return lengths
    raise UsageError(f"no body is defined for skeleton {skeleton!r}: cmu17, paper15 or body17")


def bone_lengths(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Median length (J - 1,) of each bone over frames (T, J, 3)."""
    parents, children = np.array(skeleton.bones).T
    lengths: FloatArray = np.nanmedian(
        np.linalg.norm(xyz[:, children] - xyz[:, parents], axis=-1), axis=0
    )
    return lengths


def retarget(xyz: FloatArray, skeleton: Skeleton, lengths: FloatArray) -> FloatArray:
    """The same bone directions with other bone lengths, root at the origin.

    xyz: (..., J, 3); lengths: (J - 1,). A bone of length zero stays of length zero.
    """
    out = np.zeros_like(xyz)
    for (parent, child), length in zip(skeleton.bones, lengths, strict=True):
        bone = xyz[..., child, :] - xyz[..., parent, :]
        norm = np.linalg.norm(bone, axis=-1, keepdims=True)
        direction = np.divide(bone, norm, out=np.zeros_like(bone), where=norm > 0)
        out[..., child, :] = out[..., parent, :] + length * direction
    return out
