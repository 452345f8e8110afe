"""Where keypoints jump, joints are less sure: the lifter does not follow, or follows wrongly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dance2pose.poses import FloatArray, Track2D, Track3D

# A joint drawn further from its keypoint than so many times what is usual for it was not followed.
_USUAL = 3.0


def doubted_where_keypoints_jump(poses: Track3D, track: Track2D) -> Track3D:
    """The poses with a larger sigma where a joint lies unusually far from its keypoint.

    What the distance in the picture exceeds the usual by is an error of at least that size in
    space, of the keypoint or of the joint; it is added in quadrature. Elsewhere sigma stays.
    """
    error = poses.reprojection_error
    if poses.sigma is None or not np.isfinite(error).any():
        return poses
    known = np.isfinite(error)
    usual = [
        np.median(column[seen]) if seen.any() else np.inf
        for column, seen in zip(error.T, known.T, strict=True)
    ]
    excess_px = np.where(known, np.maximum(error - _USUAL * np.array(usual), 0.0), 0.0)
    if not excess_px.any():
        return poses
    excess = excess_px * _unit_per_px(poses.xyz, track.xy)
    return replace(poses, sigma=np.hypot(poses.sigma, excess).astype(poses.sigma.dtype))


def _unit_per_px(xyz: FloatArray, xy: FloatArray) -> float:
    """The length in space that a pixel at the dancer spans: from the heights of the figure."""
    joints, points = _extents(xyz[..., 1]), _extents(xy[..., 1])
    known = np.isfinite(joints) & (np.isfinite(xy[..., 1]).sum(axis=1) > 1)
    ratios = joints[known] / np.maximum(points[known], 1e-9)
    return float(np.median(ratios)) if len(ratios) else 0.0


def _extents(values: FloatArray) -> FloatArray:
    """From the lowest to the highest (T,) of the known values (T, J); NaN where none is."""
    return np.asarray(np.fmax.reduce(values, axis=1) - np.fmin.reduce(values, axis=1))
