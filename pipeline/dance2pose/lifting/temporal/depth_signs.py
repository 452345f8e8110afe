"""Which end of each bone is nearer, settled by the whole track.

A bone of known length seen under an orthographic camera leaves two poses: one end nearer, or the
other, by d = sqrt(length^2 - projection^2). It can only change from one to the other where d is
about zero. So each bone is a chain of two states whose evidence, the network's depths, adds up
over all frames between two such moments (forward-backward algorithm).

T frames, J joints, mm; x right, y up, z towards the viewer.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

# A bone's end moves towards or away from the viewer by up to about this, mm/s.
_SPEED = 1000.0
# Of the variance that the network expects for the depths of a bone's two ends: they err together.
APART_VARIANCE = 0.5
# How much farther keypoints and lengths err than is known of them: of lasting errors of 15 mm the
# track shows about 10, and smoothing keeps what it cannot see.
_UNSEEN_ERRORS = 2.0
# The network errs alike as long as the pose is alike: evidence counts anew when joints have moved
# by so many mm in the picture, on average, or after so many seconds.
_NEW_POSE_MM, _NEW_AFTER_S = 36.0, 1.5
# Log odds that frames before or after tell of one, and of all together, at most.
_SUREST, _SUREST_TOGETHER = np.log(2e12), 30.0


def settle_depths(
    xyz: FloatArray,
    sigma_z: FloatArray,
    sigma_xy: FloatArray,
    time_s: FloatArray,
    skeleton: Skeleton,
    lengths: FloatArray,
    *,
    spread: FloatArray | float = 0.015,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Depths (T, J) that agree with the bones' lengths, their variance (T, J) mm^2, and the log
    odds (T, J - 1) that each bone's end is on the side where it is put.

    xyz: (T, J, 3) with the network's depths. sigma_z, sigma_xy: (T, J) of depth and of either
    coordinate of the picture. lengths: (J - 1,); spread: how well each is known, as a
    part of it.
    """
    parents, children = np.array(skeleton.bones).T
    bone = xyz[:, children] - xyz[:, parents]
    predicted = bone[..., 2]
    predicted_variance = APART_VARIANCE * (sigma_z[:, children] ** 2 + sigma_z[:, parents] ** 2)
    across2 = np.square(bone[..., :2]).sum(axis=-1)
    across_variance = sigma_xy[:, children] ** 2 + sigma_xy[:, parents] ** 2
    across_variance = _UNSEEN_ERRORS**2 * across_variance
    # d^2 and the standard deviation of its error, from the errors of length and projection.
    square = lengths**2 - across2
    square_sigma = 2 * np.sqrt((spread * lengths**2) ** 2 + across2 * across_variance + 1.0)
    apart = np.sqrt(np.maximum(square, 0.0))
    count = _new_evidence(xyz[..., :2], time_s)
    log_odds = _log_odds_nearer(predicted, predicted_variance, apart, square_sigma, time_s, count)
    sign = np.tanh(log_odds / 2)
    # Where d is small its error is large: d^2 = square +- square_sigma bounds it.
    apart_variance = np.minimum(square_sigma**2 / (4 * np.maximum(apart, 1.0) ** 2), square_sigma)
    settled_variance = apart_variance + (1 - sign**2) * apart**2
    trust = predicted_variance / (predicted_variance + settled_variance)
    step = predicted + trust * (sign * apart - predicted)
    variance = predicted_variance * settled_variance / (predicted_variance + settled_variance)
    depths, depth_variance = _depths(xyz[..., 2], sigma_z**2, step, variance, skeleton)
    return depths, depth_variance, np.abs(log_odds)


def _log_odds_nearer(
    predicted: FloatArray,
    predicted_variance: FloatArray,
    apart: FloatArray,
    square_sigma: FloatArray,
    time_s: FloatArray,
    count: FloatArray,
) -> FloatArray:
    """Log odds (T, B) that the bone's far end is nearer to the viewer than its near one."""
    scale = np.sqrt(predicted_variance / 2)  # of a Laplace distribution
    evidence = count[:, None] * (np.abs(predicted + apart) - np.abs(predicted - apart)) / scale
    # The way from one state to the other leads through zero; d itself is uncertain there.
    way = (apart[1:] + apart[:-1]) ** 2
    reach = (_SPEED * np.diff(time_s)[:, None]) ** 2 + square_sigma[1:] + square_sigma[:-1]
    flip = 0.5 * np.exp(-way / (2 * reach))
    total = evidence + sum(_of_neighbours(evidence, flip))
    return np.asarray(np.clip(total, -_SUREST_TOGETHER, _SUREST_TOGETHER))


def _of_neighbours(evidence: FloatArray, flip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log odds (T, B) by the evidence (T, B) of all frames before each, and by that of all after.

    flip: (T - 1, B) probability of another state in the next frame. Odds of before and of after
    are carried in one loop, and odds rather than their logarithms: ratios are cheap.
    """
    ratio = np.exp(np.clip(evidence, -100, 100))
    ratio = np.stack([ratio, ratio[::-1]], axis=1)
    flip = np.stack([flip, flip[::-1]], axis=1)
    stay = 1 - flip
    odds = np.ones_like(ratio)
    most = np.exp(_SUREST)
    least, above, below = 1 / most, np.empty_like(ratio[0]), np.empty_like(ratio[0])
    told = ratio[:-1]
    steps = zip(odds[:-1], odds[1:], stay * told, flip * told, stay, flip, strict=True)
    for now, after, stay_told, flip_told, stays, flips in steps:
        np.add(np.multiply(stay_told, now, out=above), flips, out=above)
        np.add(np.multiply(flip_told, now, out=below), stays, out=below)
        np.divide(above, below, out=after)
        np.minimum(np.maximum(after, least, out=after), most, out=after)
    forward, backward = np.log(odds).transpose(1, 0, 2)
    return forward, backward[::-1]


def _new_evidence(xy: FloatArray, time_s: FloatArray) -> FloatArray:
    """How much (T,) each frame adds to what its neighbours tell, at most 1."""
    if len(xy) < 2:
        return np.ones(len(xy))
    moved = np.linalg.norm(np.diff(xy, axis=0), axis=-1).mean(axis=1)
    new = moved / _NEW_POSE_MM + np.diff(time_s) / _NEW_AFTER_S
    return np.asarray(np.minimum((np.r_[new[:1], new] + np.r_[new, new[-1:]]) / 2, 1.0))


def _depths(
    predicted: FloatArray,
    predicted_variance: FloatArray,
    step: FloatArray,
    step_variance: FloatArray,
    skeleton: Skeleton,
) -> tuple[FloatArray, FloatArray]:
    """Least squares: joints (T, J) near where they were predicted, bones (T, J - 1) as settled.

    Bones make a tree: joints are eliminated from its leaves inwards, and solved from its root
    outwards, each as it follows from its parent. All frames at once, without a matrix.
    """
    # The sum of all joints' errors is common to them (the root's own error): weak, not nothing.
    weight = 0.25 / predicted_variance.T
    right = weight * predicted.T
    stiff, step = 1 / step_variance.T, step.T
    share = np.empty_like(stiff)
    for b, (p, c) in reversed(list(enumerate(skeleton.bones))):
        share[b] = stiff[b] / (weight[c] + stiff[b])
        right[p] += share[b] * (right[c] - weight[c] * step[b])
        weight[p] += share[b] * weight[c]
    depths, variance = right / weight, 1 / weight
    for b, (p, c) in enumerate(skeleton.bones):
        alone = 1 / (weight[c] + stiff[b])
        depths[c] = alone * right[c] + share[b] * (depths[p] + step[b])
        variance[c] = alone + share[b] ** 2 * variance[p]
    return np.ascontiguousarray(depths.T), np.ascontiguousarray(variance.T)
