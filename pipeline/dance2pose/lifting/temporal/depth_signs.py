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
_CHUNK = 512  # frames solved together


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
    nearer = _probability_nearer(predicted, predicted_variance, apart, square_sigma, time_s, count)
    sign = 2 * nearer - 1
    # Where d is small its error is large: d^2 = square +- square_sigma bounds it.
    apart_variance = np.minimum(square_sigma**2 / (4 * np.maximum(apart, 1.0) ** 2), square_sigma)
    settled_variance = apart_variance + (1 - sign**2) * apart**2
    trust = predicted_variance / (predicted_variance + settled_variance)
    step = predicted + trust * (sign * apart - predicted)
    variance = predicted_variance * settled_variance / (predicted_variance + settled_variance)
    depths, depth_variance = _depths(xyz[..., 2], sigma_z**2, step, variance, skeleton)
    return depths, depth_variance, np.abs(np.log(nearer) - np.log1p(-nearer))


def _probability_nearer(
    predicted: FloatArray,
    predicted_variance: FloatArray,
    apart: FloatArray,
    square_sigma: FloatArray,
    time_s: FloatArray,
    count: FloatArray,
) -> FloatArray:
    """Probability (T, B) that the bone's far end is nearer to the viewer than its near one."""
    frames = len(predicted)
    scale = np.sqrt(predicted_variance / 2)  # of a Laplace distribution
    evidence = count[:, None] * (np.abs(predicted + apart) - np.abs(predicted - apart)) / scale
    # The way from one state to the other leads through zero; d itself is uncertain there.
    way = (apart[1:] + apart[:-1]) ** 2
    reach = (_SPEED * np.diff(time_s)[:, None]) ** 2 + square_sigma[1:] + square_sigma[:-1]
    flip = 0.5 * np.exp(-way / (2 * reach))
    forward, backward = np.zeros_like(predicted), np.zeros_like(predicted)
    for t in range(1, frames):
        forward[t] = _carried(forward[t - 1] + evidence[t - 1], flip[t - 1])
    for t in range(frames - 2, -1, -1):
        backward[t] = _carried(backward[t + 1] + evidence[t + 1], flip[t])
    total = np.clip(forward + evidence + backward, -30, 30)
    return np.asarray(1 / (1 + np.exp(-total)))


def _new_evidence(xy: FloatArray, time_s: FloatArray) -> FloatArray:
    """How much (T,) each frame adds to what its neighbours tell, at most 1."""
    if len(xy) < 2:
        return np.ones(len(xy))
    moved = np.linalg.norm(np.diff(xy, axis=0), axis=-1).mean(axis=1)
    new = moved / _NEW_POSE_MM + np.diff(time_s) / _NEW_AFTER_S
    return np.asarray(np.minimum((np.r_[new[:1], new] + np.r_[new, new[-1:]]) / 2, 1.0))


def _carried(odds: FloatArray, flip: FloatArray) -> FloatArray:
    """Log odds of a state after a step in which it changes with probability `flip`."""
    tilt = (1 - 2 * flip) * np.tanh(np.clip(odds, -50, 50) / 2)
    return np.asarray(2 * np.arctanh(np.clip(tilt, -1 + 1e-12, 1 - 1e-12)))


def _depths(
    predicted: FloatArray,
    predicted_variance: FloatArray,
    step: FloatArray,
    step_variance: FloatArray,
    skeleton: Skeleton,
) -> tuple[FloatArray, FloatArray]:
    """Least squares: joints (T, J) near where they were predicted, bones (T, J - 1) as settled.

    Frames have nothing to do with each other here, and each has a matrix (J, J): some at a time.
    """
    depths, variance = np.empty_like(predicted), np.empty_like(predicted)
    for start in range(0, len(predicted), _CHUNK):
        rows = slice(start, start + _CHUNK)
        depths[rows], variance[rows] = _depths_of_frames(
            predicted[rows], predicted_variance[rows], step[rows], step_variance[rows], skeleton
        )
    return depths, variance


def _depths_of_frames(
    predicted: FloatArray,
    predicted_variance: FloatArray,
    step: FloatArray,
    step_variance: FloatArray,
    skeleton: Skeleton,
) -> tuple[FloatArray, FloatArray]:
    frames, joints = predicted.shape
    # The sum of all joints' errors is common to them (the root's own error): weak, not nothing.
    weight = 0.25 / predicted_variance
    normal = np.zeros((frames, joints, joints))
    diagonal = np.arange(joints)
    normal[:, diagonal, diagonal] = weight
    right = weight * predicted
    for b, (p, c) in enumerate(skeleton.bones):
        w = 1 / step_variance[:, b]
        normal[:, p, p] += w
        normal[:, c, c] += w
        normal[:, p, c] -= w
        normal[:, c, p] -= w
        right[:, c] += w * step[:, b]
        right[:, p] -= w * step[:, b]
    inverse = np.linalg.inv(normal)
    depths = (inverse @ right[..., None])[..., 0]
    return depths, np.ascontiguousarray(inverse[:, diagonal, diagonal])
