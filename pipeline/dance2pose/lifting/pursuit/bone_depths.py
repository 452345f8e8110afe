"""Poses with exact bone lengths: what the image leaves open of a bone is the sign of its depth.

Under weak perspective a bone of known length that shows (dx, dy) has depth +-sqrt(l^2 - dx^2 -
dy^2). The pursuit, which knows poses but is only near the image, chooses the sign; the limits may
overrule it (Akhter & Black, CVPR 2015, choose depth signs by their limits). Where a bone lies
nearly across the view, a small error of the image is a large one of that depth; there the
pursuit's own depth counts for more.
"""

from __future__ import annotations

import numpy as np

from dance2pose.lifting.pursuit.pursue import PoseLimits
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# Chosen on held-out takes for keypoints with errors of 0 to 60 mm on the one body (about twice
# what good keypoint models make): how far a keypoint may pull a joint from where the pursuit puts
# it; the error of the depth of a bone in the pursuit; how much larger the error of keypoints may
# be than what the pursuit leaves of them, which is fitted to them; and that of the scale.
_PULL_MM = 20.0
_DEPTH_ERROR_MM = 60.0
_NOISE_FACTOR = 2.0
_SCALE_ERROR = 0.02


def with_exact_depths(
    xyz: FloatArray,
    observed: FloatArray,
    seen: BoolArray,
    left_mm: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    limits: PoseLimits | None = None,
) -> FloatArray:
    """Poses (N, J, 3) mm with bones of `lengths` (J - 1,), first joint at the origin.

    xyz: (N, J, 3) mm as the pursuit found them, seen along z. observed: (N, J, 2) mm, the keypoints
    through the inverse of the camera found. seen: (N, J) True where they may be believed; bones
    that end in a joint not seen keep the pursuit's direction. left_mm: (N,) root mean square of
    what the pursuit leaves of a keypoint's coordinate. limits: bones that break one are turned to
    the other depth where that leaves fewer bones broken.
    """
    parents, children = np.array(skeleton.bones).T
    image = xyz[..., :2] + _pulled(observed - xyz[..., :2], seen)
    flat = image[:, children] - image[:, parents]
    guess = xyz[:, children] - xyz[:, parents]
    depth = _depth(flat, guess[..., 2], left_mm, lengths)
    bones = np.concatenate([flat, depth[..., None]], axis=-1)
    whole = seen[:, children] & seen[:, parents]
    bones = np.where(whole[..., None], bones, guess)
    norm = np.linalg.norm(bones, axis=-1, keepdims=True)
    bones *= lengths[:, None] / np.maximum(norm, 1e-9)
    if limits is not None:
        _flip_broken(bones, skeleton, limits)
    return _joined(bones, skeleton)


def _depth(
    flat: FloatArray, guess: FloatArray, left_mm: FloatArray, lengths: FloatArray
) -> FloatArray:
    """Depths (N, J - 1) of bones that show (N, J - 1, 2): their length's and the pursuit's, each
    weighted by the inverse of its variance."""
    shown = np.linalg.norm(flat, axis=-1)
    exact = np.sqrt(np.maximum(lengths**2 - shown**2, 0.0))
    noise = np.hypot(_NOISE_FACTOR * left_mm[:, None], _SCALE_ERROR * shown)
    # d(depth) = shown / depth * d(shown), which near depth 0 is sqrt(shown * d(shown)).
    error = shown * noise / np.maximum(exact, np.sqrt(shown * noise) + 1e-9)
    trust = _DEPTH_ERROR_MM**2 / (_DEPTH_ERROR_MM**2 + error**2)
    depth: FloatArray = trust * np.where(guess < 0, -exact, exact) + (1 - trust) * guess
    return depth


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
