"""Turning poses so that they face one way: a dictionary then holds shape, not heading."""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton


def body_axes(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Rotations (..., 3, 3) body_from_world of poses (..., J, 3).

    Body axes: y along the spine (first joint to neck), x to the body's left, as near as it can be
    to the mean of the shoulder line and the hip line, z to the front. A pose without torso (all
    of it in one point or on one line) gives NaN.
    """

    def across(left: str, right: str) -> FloatArray:
        line: FloatArray = xyz[..., skeleton.index(left), :] - xyz[..., skeleton.index(right), :]
        unit: FloatArray = line / np.linalg.norm(line, axis=-1, keepdims=True)
        return unit

    with np.errstate(invalid="ignore", divide="ignore"):
        spine = xyz[..., 1, :] - xyz[..., 0, :]
        y = spine / np.linalg.norm(spine, axis=-1, keepdims=True)
        left = across("left_shoulder", "right_shoulder") + across("left_hip", "right_hip")
        x = left - (left * y).sum(axis=-1, keepdims=True) * y
        x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    axes: FloatArray = np.stack([x, y, np.cross(x, y)], axis=-2)
    return axes


def to_body_axes(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Poses (..., J, 3) turned into their own body axes, first joint at the origin."""
    centred = xyz - xyz[..., :1, :]
    turned: FloatArray = centred @ np.swapaxes(body_axes(xyz, skeleton), -1, -2)
    return turned


def mirrored(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """The mirror images of poses (..., J, 3): left and right swapped, x negated."""
    image: FloatArray = xyz[..., skeleton.mirror, :] * np.array([-1.0, 1.0, 1.0])
    return image


def similarity(
    moving: FloatArray, fixed: FloatArray, *, scaled: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Rotations (..., 3, 3) and scales (...) that take poses (..., J, 3) closest to `fixed`.

    Both are centred on their mean first (translation is free). Proper rotations only.
    """
    a = moving - moving.mean(axis=-2, keepdims=True)
    b = fixed - fixed.mean(axis=-2, keepdims=True)
    u, s, vt = np.linalg.svd(np.swapaxes(b, -1, -2) @ a)
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    u = np.concatenate([u[..., :2], u[..., 2:] * sign[..., None, None]], axis=-1)
    s = np.concatenate([s[..., :2], s[..., 2:] * sign[..., None]], axis=-1)
    rotation: FloatArray = u @ vt
    scale = s.sum(axis=-1) / (a * a).sum(axis=(-1, -2)) if scaled else np.ones(rotation.shape[:-2])
    return rotation, scale
