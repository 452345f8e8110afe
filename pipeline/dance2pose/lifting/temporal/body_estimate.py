"""Bone lengths of one dancer from everything that a track says of them.

There are two sources for the length of each bone: its depths together with its projections, frame
by frame, and the length that the network predicts. Both are read as measurements of the logarithm
of the length with a known error; what people's bones are like (`body_variation`), or the body that
the user gives, is the prior. All errors are taken for Gaussian, so that the estimate is one linear
system, and where the track says nothing of a bone the prior alone remains.

N frames, J joints, B = J - 1 bones of a lifting skeleton.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.body import Body, body_bones_mm
from dance2pose.body_variation import log_covariance
from dance2pose.poses import FloatArray

# Neighbouring frames err alike: they count as one measurement in so many seconds.
_INDEPENDENT_S = 0.7
# However many frames agree, what they have in common (one camera, one network) errs by this part.
_COMMON_ERROR = 0.015
# A frame whose bone looks wrong by more than so many standard deviations counts less.
_OUTLIER = 2.5
_REWEIGHTED = 4
# How much farther the network's lengths of a whole track err than it says of a frame's: what it
# makes of a body is one opinion, and told with the same longest projections (held-out takes).
_ONE_OPINION = 2.0
# The part of the variance that the network expects for both ends of a bone which its depth lacks.
_HEDGED = 0.1


@dataclass(frozen=True)
class Measured:
    """log_length: (B,), in any one unit beside the one body's bones; NaN where nothing is known.
    sigma: (B,) its standard deviation."""

    log_length: FloatArray
    sigma: FloatArray


def from_depths(
    bone: FloatArray,
    depth_variance: FloatArray,
    picture_variance: FloatArray,
    time_s: FloatArray,
    body_mm: FloatArray,
) -> Measured:
    """What bones (N, B, 3) with depths of known error say of their lengths.

    bone: from parent to child, mm, NaN where its ends were not seen. depth_variance: (N, B) mm^2 of
    its third coordinate, picture_variance: of either of the others. The square of a length is the
    mean of the squares of its coordinates plus the variance of the depth, which is hedged towards
    zero by just as much, less the variance of what was seen, which adds. Frames count by how well
    they tell the length: those where the bone lies across the view most.
    """
    log_length, error = lengths_by_frame(bone, depth_variance, picture_variance, body_mm)
    usable = np.isfinite(error)
    share = _share_of_evidence(time_s)[:, None] * usable
    weight = share / np.where(usable, error, 1.0) ** 2
    mean = robust_mean(log_length, weight, np.hypot(np.where(usable, error, 1.0), _COMMON_ERROR))
    with np.errstate(divide="ignore"):
        sigma = np.hypot(1 / np.sqrt(weight.sum(axis=0)), _COMMON_ERROR)
    return Measured(np.where(np.isfinite(sigma), mean, np.nan), sigma)


def lengths_by_frame(
    bone: FloatArray, depth_variance: FloatArray, picture_variance: FloatArray, body_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Logarithms (N, B) of the lengths of bones beside those of a body, and their errors.

    Arguments as in `from_depths`. Infinite errors where nothing is known.
    """
    across2 = np.square(bone[..., :2]).sum(axis=-1)
    depth2 = np.square(bone[..., 2])
    square = across2 + depth2 + _HEDGED * depth_variance - 2 * picture_variance
    usable = np.isfinite(square) & (square > (0.1 * body_mm) ** 2)
    length = np.sqrt(np.where(usable, square, 1.0))
    error = np.sqrt(depth2 * depth_variance + depth_variance**2 / 2 + across2 * picture_variance)
    error = np.where(usable, np.hypot(error / length**2, 0.01), np.inf)
    return np.asarray(np.where(usable, np.log(length / body_mm), 0.0)), np.asarray(error)


def from_network(bones: FloatArray, bones_sigma: FloatArray) -> Measured:
    """What the network predicts: (N, B) logarithms of lengths and the scales of their errors.

    Every frame was answered knowing the whole track's longest projections, so that frames hardly
    err independently: averaging them makes the mean no surer than one of them.
    """
    weight = 1 / bones_sigma**2
    mean = weighted_mean(bones, weight)
    return Measured(mean, _ONE_OPINION * np.sqrt(len(bones) / weight.sum(axis=0)))


def estimate(
    measured: list[Measured],
    skeleton: str,
    known: Body | None = None,
    *,
    predicted: Measured | None = None,
) -> tuple[Body, float]:
    """The body that explains the measurements best, and the size of their unit.

    known: a body found before, which then stands in for what people's bones are like; else the
    network's prediction does, where there is one: it knows them, and has seen the track. Sizes are
    told by nothing that one camera sees: the body has the sum of the one body's bone lengths, and
    the measurements' unit is the second result times a millimetre of it.
    """
    usual = body_bones_mm(skeleton)
    mean: FloatArray = np.zeros(len(usual))
    covariance = log_covariance()
    if known is not None:
        mean = np.log(known.lengths_mm / usual)
        covariance = np.diag(known.spread**2)
    elif predicted is not None and np.isfinite(predicted.log_length).all():
        mean = predicted.log_length
        sigma = np.sqrt(np.diag(covariance))
        covariance = covariance * np.outer(predicted.sigma / sigma, predicted.sigma / sigma)
    precision = np.zeros((len(usual) + 1, len(usual) + 1))  # of the bones, and of the common size
    precision[:-1, :-1] = np.linalg.inv(covariance)
    right = precision[:, :-1] @ mean
    for one in measured:
        known_bones = np.isfinite(one.log_length) & np.isfinite(one.sigma)
        weight = np.where(known_bones, 1 / np.where(known_bones, one.sigma, 1.0) ** 2, 0.0)
        value = np.where(known_bones, one.log_length, 0.0)
        precision[:-1, :-1] += np.diag(weight)
        precision[:-1, -1] += weight
        precision[-1, :-1] += weight
        precision[-1, -1] += weight.sum()
        right[:-1] += weight * value
        right[-1] += weight @ value
    precision[-1, -1] += 1e-6
    both = np.linalg.inv(precision)
    found = both @ right
    lengths = usual * np.exp(found[:-1])
    whole = lengths.sum() / usual.sum()
    # Known beside the other bones, not beside a metre: less what is common to all.
    part = lengths / lengths.sum()
    beside = np.eye(len(usual)) - part
    spread = np.sqrt(np.einsum("bi,ij,bj->b", beside, both[:-1, :-1], beside))
    return Body(skeleton, lengths / whole, spread), float(np.exp(found[-1]) * whole)


def _share_of_evidence(time_s: FloatArray) -> FloatArray:
    """How much (N,) each frame counts of a measurement, at most 1."""
    if len(time_s) < 2:
        return np.ones(len(time_s))
    step = np.diff(time_s)
    between = np.minimum((np.r_[step[:1], step] + np.r_[step, step[-1:]]) / 2, _INDEPENDENT_S)
    return np.asarray(np.clip(between / _INDEPENDENT_S, 0.0, 1.0))


def robust_mean(values: FloatArray, weight: FloatArray, error: FloatArray) -> FloatArray:
    """The mean (B,) of values (N, B) in which those count less that are far off by their error."""
    mean = weighted_mean(values, weight)
    for _ in range(_REWEIGHTED):
        off = np.abs(values - mean) / error
        mean = weighted_mean(values, weight * np.minimum(1.0, _OUTLIER / np.maximum(off, 1e-9)))
    return mean


def weighted_mean(values: FloatArray, weight: FloatArray) -> FloatArray:
    total = weight.sum(axis=0)
    mean = (np.where(weight > 0, values, 0.0) * weight).sum(axis=0) / np.maximum(total, 1e-300)
    return np.asarray(np.where(total > 0, mean, np.nan))
