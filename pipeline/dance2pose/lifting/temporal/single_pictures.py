"""Pictures that have nothing to do with each other, each lifted by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dance2pose.body import Body
from dance2pose.lifting.temporal.body_of_track import Found, Joints
from dance2pose.lifting.temporal.bone_constraints import with_bone_lengths
from dance2pose.lifting.temporal.depth import Known, predict_frames
from dance2pose.lifting.temporal.depth_signs import settle_depths
from dance2pose.lifting.temporal.one_body import (
    Posed,
    SequenceSettings,
    bend_variance,
    error_parts,
    seen_and_predicted,
)
from dance2pose.lifting.temporal.track_rows import Rows
from dance2pose.poses import FloatArray

_NOISE_MM = 1.0
_LEAST_SPREAD = 0.01
_APART_S = 1e3  # between pictures, so that nothing flows


def pose_pictures(seen: Rows, settings: SequenceSettings) -> Posed:
    """Poses of pictures as if each were of another dancer.

    The network says what bones it takes each dancer to have, and is told them in a second pass:
    what it makes of depths then agrees with them.
    """
    known = Known(error_mm=seen.bias_mm or None)
    first = predict_frames(seen.xy, seen.confidence, body17=seen.body17, known=known)
    bones = np.exp(first.bones) * seen.usual_mm
    told = replace(known, longest=bones * first.scale[:, np.newaxis], lengths=True)
    answer = predict_frames(seen.xy, seen.confidence, body17=seen.body17, known=told)
    lengths = np.exp(answer.bones) * seen.usual_mm
    size = lengths.sum(axis=1) / seen.usual_mm.sum()
    lengths /= size[:, np.newaxis]
    spread = np.hypot(answer.sigma_bones, _LEAST_SPREAD)
    px_per_mm = answer.scale * size
    picture = (seen.xy - answer.centre[:, None]) / px_per_mm[:, None, None]
    noise = np.asarray(_NOISE_MM / np.clip(seen.confidence, 0.1, 1.0))
    joints = seen_and_predicted(answer, size, picture, np.hypot(noise, seen.bias_mm))
    if settings.flips:
        joints = _with_settled_depths(joints, seen, lengths, spread)
    xyz = joints.xyz
    if settings.bones:
        variance = bend_variance(joints)
        xyz = with_bone_lengths(xyz, variance, seen.tree, lengths, spread=spread)
    errors = error_parts(joints.sigma, answer.sigma / size[:, None], noise, seen.bias_mm)
    usual = Body(seen.skeleton, seen.usual_mm, np.median(spread, axis=0))
    return Posed(xyz, errors, px_per_mm, Found(usual, seen.bias_mm))


def _with_settled_depths(
    joints: Joints, seen: Rows, lengths: FloatArray, spread: FloatArray
) -> Joints:
    depths, variance, _ = settle_depths(
        joints.xyz,
        joints.sigma[..., 2],
        np.hypot(joints.sigma[..., 0], seen.bias_mm),
        _APART_S * np.arange(len(joints.xyz)),
        seen.tree,
        lengths,
        spread=spread,
    )
    xyz, sigma = joints.xyz.copy(), joints.sigma.copy()
    xyz[..., 2], sigma[..., 2] = depths, np.sqrt(variance)
    return Joints(xyz, sigma)
