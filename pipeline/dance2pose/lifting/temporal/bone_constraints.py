"""Poses made to have bones of given lengths.

Axes x right, y up, z towards the viewer; T frames, J joints of a lifting skeleton, mm.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

_STEPS = 5
_CHUNK = 512


def with_bone_lengths(
    xyz: FloatArray,
    variance: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    *,
    spread: FloatArray | float = 0.01,
) -> FloatArray:
    """The poses closest to xyz (T, J, 3) whose bones have about the given lengths, (J - 1,) or
    (T, J - 1).

    variance: (T, J, 3) mm^2, how readily each coordinate gives way. spread: standard deviation of
    the lengths as a part of each. Sequential quadratic programming: every step solves
    min sum |x - xyz|^2 / variance + sum (length - wanted)^2 / (spread wanted)^2, linearised.
    """
    out = np.empty_like(xyz)
    of_bones = (len(xyz), len(skeleton.bones))
    lengths, spread = (np.broadcast_to(values, of_bones) for values in (lengths, spread))
    for start in range(0, len(xyz), _CHUNK):
        rows = slice(start, start + _CHUNK)
        out[rows] = _closest(xyz[rows], variance[rows], skeleton, lengths[rows], spread[rows])
    return out


def _closest(
    xyz: FloatArray,
    variance: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    spread: FloatArray,
) -> FloatArray:
    parents, children = np.array(skeleton.bones).T
    bones = np.arange(len(children))
    frames, joints = xyz.shape[:2]
    readily = variance.reshape(frames, 1, -1)
    now = xyz
    for _ in range(_STEPS):
        bone = now[:, children] - now[:, parents]
        length = np.maximum(np.linalg.norm(bone, axis=-1), 1e-6)
        direction = bone / length[..., None]
        slope = np.zeros((frames, len(bones), joints, 3))
        slope[:, bones, children] = direction
        slope[:, bones, parents] = -direction
        flat = slope.reshape(frames, len(bones), -1)
        weighted = readily * flat
        normal = weighted @ flat.transpose(0, 2, 1)
        # The slack also keeps the step finite where a bone lies across the view and its depth,
        # the only thing that gives, does not change its length.
        normal[:, bones, bones] += (spread * lengths) ** 2 + 1.0
        off = (flat @ (xyz - now).reshape(frames, -1, 1))[..., 0] + length - lengths
        force = np.linalg.solve(normal, off[..., None])
        now = xyz - (weighted.transpose(0, 2, 1) @ force).reshape(xyz.shape)
    return now
