"""Bone lengths of one dancer from a whole track, and poses made to have them.

Axes x right, y up, z towards the viewer; T frames, J joints of a lifting skeleton, mm.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

# People's bones differ from the one body's by about this part of their length, the network's
# lengths from the truth by about that.
PRIOR_SPREAD, _NETWORK_SPREAD = 0.04, 0.05
# The projection of a bone taken for its longest, and the length that the network gives it taken
# for its true one: it errs short where it is unsure which end is nearer.
_LONGEST, _TYPICAL = 0.95, 0.75
# The first where bones seem to vary in length by this part or more: the longest projections are
# then those that err that way.
_LONGEST_UNSTEADY, _UNSTEADY = 0.8, 0.02
_LONGEST_LIKELY = 1.12
# A bone that looks longer than this, beside the median of the dancer's bones, was not seen rightly.
_TOO_LONG = 1.25
# A bone that was seen as long as it is expected to be is known this well.
_LEAST_SPREAD = 0.015
_STEPS = 5
_CHUNK = 512


def likely_projections(longest: FloatArray, body_mm: FloatArray) -> FloatArray:
    """Longest projections (J - 1,) without those that no body of this size could have.

    A keypoint that is wrong for much of a track makes its bones look far too long, and the dancer
    with them; such a bone gets the length that the others let expect. NaN stays.
    """
    ratio = longest / body_mm
    if not np.isfinite(ratio).any():
        return longest
    typical = np.nanmedian(ratio)
    return np.asarray(np.where(ratio > _TOO_LONG * typical, typical * body_mm, longest))


def track_bone_lengths(
    picture: FloatArray,
    xyz: FloatArray,
    skeleton: Skeleton,
    body_mm: FloatArray,
    *,
    wobble: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """The bone lengths (J - 1,) of one dancer, from a whole track, and how uncertain each is, as a
    part of it.

    picture: (T, J, 2) where joints were seen, NaN where not. xyz: (T, J, 3) with the network's
    depths, in the same unit. body_mm: (J - 1,) of the one body, left and right alike. wobble: how
    much bones seem to vary in length from frame to frame, as a part of it.

    The camera shows a bone at full length whenever the bone lies across the view. Over a track
    most bones do at some time, so those that look longest, compared with the one body, tell the
    size of the dancer; a bone that looks shorter may only have been foreshortened all the time:
    there the one body and the network's depths speak as well.
    """
    parents, children = np.array(skeleton.bones).T
    pair = np.array([m - 1 for m in skeleton.mirror[1:]])

    def both_sides(lengths: FloatArray, quantile: float) -> FloatArray:
        known = np.isfinite(lengths).any(axis=0)
        out = np.full(lengths.shape[1], np.nan)
        out[known] = np.nanquantile(lengths[:, known], quantile, axis=0)
        return out

    flat = np.linalg.norm(picture[:, children] - picture[:, parents], axis=-1)
    unsteady = min(wobble / _UNSTEADY, 1.0)
    longest = both_sides(flat, _LONGEST + unsteady * (_LONGEST_UNSTEADY - _LONGEST))
    longest = likely_projections(np.fmax(longest, longest[pair]), body_mm)
    solid = both_sides(np.linalg.norm(xyz[:, children] - xyz[:, parents], axis=-1), _TYPICAL)
    solid = (solid + solid[pair]) / 2
    ratio = np.sort((longest / body_mm)[np.isfinite(longest)])
    size = (
        float(np.median(ratio[len(ratio) // 2 :]))
        if len(ratio)
        else float(np.mean(solid / body_mm))
    )
    prior, network = 1 / PRIOR_SPREAD**2, 1 / _NETWORK_SPREAD**2
    ratio_solid = np.clip(solid / (size * body_mm), 0.8, 1.2)
    expected = size * body_mm * (prior + network * ratio_solid) / (prior + network)
    # Longer than people's bones are: keypoints that are wrong for much of the track.
    lengths = np.fmax(expected, np.fmin(longest, _LONGEST_LIKELY * expected))
    unseen = np.abs(np.nan_to_num((lengths - longest) / lengths, nan=1.0))
    return lengths, np.hypot(np.clip(unseen, _LEAST_SPREAD, PRIOR_SPREAD), wobble)


def with_bone_lengths(
    xyz: FloatArray,
    variance: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    *,
    spread: FloatArray | float = 0.01,
) -> FloatArray:
    """The poses closest to xyz (T, J, 3) whose bones have about the given lengths (J - 1,).

    variance: (T, J, 3) mm^2, how readily each coordinate gives way. spread: standard deviation of
    the lengths as a part of each. Sequential quadratic programming: every step solves
    min sum |x - xyz|^2 / variance + sum (length - wanted)^2 / (spread wanted)^2, linearised.
    """
    out = np.empty_like(xyz)
    for start in range(0, len(xyz), _CHUNK):
        rows = slice(start, start + _CHUNK)
        out[rows] = _closest(xyz[rows], variance[rows], skeleton, lengths, spread)
    return out


def _closest(
    xyz: FloatArray,
    variance: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    spread: FloatArray | float,
) -> FloatArray:
    parents, children = np.array(skeleton.bones).T
    bones = np.arange(len(children))
    frames, joints = xyz.shape[:2]
    give = variance.reshape(frames, 1, -1)
    now = xyz
    for _ in range(_STEPS):
        bone = now[:, children] - now[:, parents]
        length = np.maximum(np.linalg.norm(bone, axis=-1), 1e-6)
        direction = bone / length[..., None]
        slope = np.zeros((frames, len(bones), joints, 3))
        slope[:, bones, children] = direction
        slope[:, bones, parents] = -direction
        flat = slope.reshape(frames, len(bones), -1)
        weighted = give * flat
        normal = weighted @ flat.transpose(0, 2, 1)
        # The slack also keeps the step finite where a bone lies across the view and its depth,
        # the only thing that gives, does not change its length.
        normal[:, bones, bones] += (spread * lengths) ** 2 + 1.0
        off = (flat @ (xyz - now).reshape(frames, -1, 1))[..., 0] + length - lengths
        force = np.linalg.solve(normal, off[..., None])
        now = xyz - (weighted.transpose(0, 2, 1) @ force).reshape(xyz.shape)
    return now
