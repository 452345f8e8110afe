"""Poses with exact bone lengths: what the image leaves open of a bone is the sign of its depth.

Under weak perspective a bone of known length that shows (dx, dy) has depth +-sqrt(l^2 - dx^2 -
dy^2). The pursuit, which knows poses but is only near the image, chooses the sign; the limits may
overrule it (Akhter & Black, CVPR 2015, choose depth signs by their limits).
"""

from __future__ import annotations

import numpy as np

from dance2pose.lifting.pursuit import PoseLimits
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# How far a keypoint may pull a joint from where the pursuit puts it, mm on the one body: a wrong
# keypoint lies a limb's length away, the pursuit's own error is a few centimetres.
_PULL_MM = 80.0


def with_exact_depths(
    xyz: FloatArray,
    observed: FloatArray,
    seen: BoolArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    limits: PoseLimits | None = None,
) -> FloatArray:
    """Poses (N, J, 3) mm with bones of `lengths` (J - 1,), first joint at the origin.

    xyz: (N, J, 3) mm as the pursuit found them, seen along z. observed: (N, J, 2) mm, the keypoints
    through the inverse of the camera found. seen: (N, J) True where they may be believed; bones
    that end in a joint not seen keep the pursuit's direction. limits: bones that break one are
    turned to the other depth where that leaves fewer bones broken.
    """
    parents, children = np.array(skeleton.bones).T
    image = xyz[..., :2] + _pulled(observed - xyz[..., :2], seen)
    flat = image[:, children] - image[:, parents]
    guess = xyz[:, children] - xyz[:, parents]
    depth = np.sqrt(np.maximum(lengths**2 - (flat**2).sum(axis=-1), 0.0))
    depth = np.where(guess[..., 2] < 0, -depth, depth)
    bones = np.concatenate([flat, depth[..., None]], axis=-1)
    whole = seen[:, children] & seen[:, parents]
    bones = np.where(whole[..., None], bones, guess)
    norm = np.linalg.norm(bones, axis=-1, keepdims=True)
    bones *= lengths[:, None] / np.maximum(norm, 1e-9)
    if limits is not None:
        _flip_broken(bones, skeleton, limits)
    return _joined(bones, skeleton)


def _pulled(offset: FloatArray, seen: BoolArray) -> FloatArray:
    size = np.linalg.norm(np.where(seen[..., None], offset, 0.0), axis=-1, keepdims=True)
    pull = np.minimum(1.0, _PULL_MM / np.maximum(size, 1e-9))
    pulled: FloatArray = np.where(seen[..., None], offset * pull, 0.0)
    return pulled


def _flip_broken(bones: FloatArray, skeleton: Skeleton, limits: PoseLimits) -> None:
    """Turn bones (N, J - 1, 3) that break a limit, or their parents, to the other depth."""
    valid = limits.is_valid(_joined(bones, skeleton))
    for bone in range(bones.shape[1]):
        rows = np.flatnonzero(~valid[:, bone])
        parent = skeleton.parents[bone + 1] - 1
        choices = [[bone], [parent], [bone, parent]] if parent >= 0 else [[bone]]
        for choice in choices:
            if not len(rows):
                break
            turned = bones[rows]
            turned[:, choice, 2] *= -1
            flags = limits.is_valid(_joined(turned, skeleton))
            better = flags.sum(axis=1) > valid[rows].sum(axis=1)
            bones[rows[better]] = turned[better]
            valid[rows[better]] = flags[better]
            rows = rows[~better]


def _joined(bones: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Joints (N, J, 3) of bone vectors (N, J - 1, 3), first joint at the origin."""
    xyz = np.zeros((len(bones), bones.shape[1] + 1, 3))
    for bone, (parent, child) in enumerate(skeleton.bones):
        xyz[:, child] = xyz[:, parent] + bones[:, bone]
    return xyz
