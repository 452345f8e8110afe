"""Where a pose that is not exactly known must stand to be seen as it was.

The size of a figure tells its distance. Of a bone that lies across the view the picture shows the
whole length, whatever its depth errs by; one that points at the camera shows hardly any, and its
error of depth makes a large one of what it should show. So each joint is weighed by what lies
between it and the others: generalised least squares, in which the errors of bones add up along
the skeleton and those of keypoints do not.

T frames, J joints; axes of a camera that points at the dancer, x right, y up, z towards the viewer;
mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# Errors of keypoints count so often: the pose was drawn towards them, and bones with it.
_KEYPOINTS = 2.0
_LEAST_MM = 2.0  # that anything errs by
_SHORTEST_MM = 20.0  # that a bone is taken to look
_UNSEEN_MM2 = 1e10
# A figure smaller than this part of its distance has none that could be told.
_LEAST_EXTENT = 1e-4
_CHUNK = 1024  # frames at a time: each takes several KB


@dataclass(frozen=True)
class Place:
    """at: (T, 3) the first joint. along, across: (T,) standard deviations along the view and in
    either direction across it. NaN where fewer than two joints were seen, or all at one point."""

    at: FloatArray
    along: FloatArray
    across: FloatArray


def place(
    xyz: FloatArray, flat: FloatArray, confidence: FloatArray, errors: ErrorParts, tree: Skeleton
) -> Place:
    """Where poses must stand.

    xyz: (T, J, 3), first joint at the origin. flat: (T, J, 2) what was seen, as parts of the focal
    length, NaN where nothing was. confidence: (T, J), 0 to 1. errors: of the poses.
    """
    parts = [
        _place(xyz[rows], flat[rows], confidence[rows], errors.at(rows), tree)
        for rows in (slice(start, start + _CHUNK) for start in range(0, len(xyz), _CHUNK))
    ]
    return Place(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _place(
    xyz: FloatArray, flat: FloatArray, confidence: FloatArray, errors: ErrorParts, tree: Skeleton
) -> tuple[FloatArray, FloatArray, FloatArray]:
    seen: BoolArray = np.isfinite(flat).all(axis=-1) & (confidence > 0)
    flat, pose = np.where(seen[..., None], flat, 0.0), np.nan_to_num(xyz)
    # A joint at p + t, t = (tx, ty, -D), is seen at f where p + t = f (D - pz) across the view.
    apart = np.where(seen[..., None], -(pose[..., :2] + flat * pose[..., 2:]), 0.0)
    covariance = _covariance(pose, seen, confidence, errors, tree)
    together = np.concatenate([seen[..., None], flat, apart], axis=-1)
    weighted = np.linalg.solve(covariance, together)
    normal = together.transpose(0, 2, 1) @ weighted  # of 1, fx, fy, yx, yy with each other
    ones = np.maximum(normal[:, 0, 0], 1e-300)
    f, y = normal[:, 0, 1:3], normal[:, 0, 3:5]
    information = (np.diagonal(normal[:, 1:3, 1:3], axis1=1, axis2=2) - f**2 / ones[:, None]).sum(1)
    shared = np.diagonal(normal[:, 1:3, 3:5], axis1=1, axis2=2) - f * y / ones[:, None]
    known = (seen.sum(axis=1) >= 2) & np.isfinite(xyz).all(axis=(1, 2))
    known &= information > ones * _LEAST_EXTENT**2
    distance = -shared.sum(axis=1) / np.where(known, information, 1.0)
    across = (y + f * distance[:, None]) / ones[:, None]
    at = np.concatenate([across, -distance[:, None]], axis=1)
    sigma = 1 / np.sqrt(np.where(known, [information, ones], 1.0))
    at[~known], sigma[:, ~known] = np.nan, np.nan
    return at, sigma[0], sigma[1]


def _covariance(
    xyz: FloatArray,
    seen: BoolArray,
    confidence: FloatArray,
    errors: ErrorParts,
    tree: Skeleton,
) -> FloatArray:
    """Of what poses show at the joints in either direction of the picture, (T, J, J) mm^2."""
    parents, children = np.array(tree.bones).T
    bone = xyz[:, children] - xyz[:, parents]
    depth = np.nan_to_num(np.square(errors.pose), nan=1.0)
    depth = depth[:, children] + depth[:, parents]
    shown = np.maximum(np.square(bone[..., :2]).sum(axis=-1), _SHORTEST_MM**2)
    # d(shown^2) = d(z^2), whose variance is that of a square of a normal.
    bones = (bone[..., 2] ** 2 * depth + depth**2 / 2) / shown + _LEAST_MM**2
    leads = _leading_to_joints(tree)
    total: FloatArray = np.einsum("jb,tb,kb->tjk", leads, bones, leads, optimize=True)
    noise = _KEYPOINTS * (np.nan_to_num(np.square(errors.noise)) + errors.bias_mm**2)
    noise = (noise + _LEAST_MM**2) / np.square(np.clip(confidence, 1e-3, 1.0))
    joints = np.arange(len(tree))
    total[:, joints, joints] += np.where(seen, noise, _UNSEEN_MM2)
    return total


def _leading_to_joints(tree: Skeleton) -> FloatArray:
    """Which bones (J, B) lead from the first joint to each, 1 or 0."""
    leads = np.zeros((len(tree), len(tree.bones)))
    for bone, (parent, child) in enumerate(tree.bones):
        leads[child] = leads[parent]
        leads[child, bone] = 1.0
    return leads
