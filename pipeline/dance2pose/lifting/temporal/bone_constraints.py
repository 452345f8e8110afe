"""Poses made to have bones of given lengths.

Axes x right, y up, z towards the viewer; T frames, J joints of a lifting skeleton, mm.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

_STEPS = 5
_CHUNK = 1024


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
    near, readily = (np.ascontiguousarray(v.transpose(1, 2, 0)) for v in (xyz, variance))
    lengths = lengths.T
    # The slack also keeps the step finite where a bone lies across the view and its depth, the
    # only thing that gives, does not change its length.
    slack = (spread.T * lengths) ** 2 + 1.0
    now = near
    for _ in range(_STEPS):
        bone = now[children] - now[parents]
        direction = bone / np.maximum(np.sqrt(_dot(bone, bone)), 1e-6)[:, None]
        now = _linearised(near, readily, skeleton, direction, lengths, slack)
    return now.transpose(2, 0, 1)


def _linearised(
    near: FloatArray,
    readily: FloatArray,
    skeleton: Skeleton,
    direction: FloatArray,
    lengths: FloatArray,
    slack: FloatArray,
) -> FloatArray:
    """Places (J, 3, T) closest to `near` whose bones (J - 1, 3, T) have about those lengths along
    given directions.

    Bones make a tree: from its leaves inwards each joint learns what those beyond it want of it
    (a Kalman filter's step: mean and covariance), then each follows from its parent.
    """
    mean, covariance = near.copy(), np.zeros((len(near), 3, *readily.shape[1:]))
    covariance[:, range(3), range(3)] = readily
    gain = np.empty_like(direction)
    for b, (parent, child) in reversed(list(enumerate(skeleton.bones))):
        along = direction[b]
        gives = _dot(covariance[child], along[:, None], axis=0)
        spare = slack[b] + _dot(along, gives, axis=0)
        gain[b] = gives / spare
        gives = _dot(covariance[parent], along[:, None], axis=0)
        pull = gives / (spare + _dot(along, gives, axis=0))
        mean[parent] += pull * (_dot(along, mean[child] - mean[parent], axis=0) - lengths[b])
        covariance[parent] -= pull[:, None] * gives
    for b, (parent, child) in enumerate(skeleton.bones):
        off = _dot(direction[b], mean[child] - mean[parent], axis=0) - lengths[b]
        mean[child] -= gain[b] * off
    return mean


def _dot(a: FloatArray, b: FloatArray, axis: int = -2) -> FloatArray:
    return np.asarray((a * b).sum(axis=axis))
