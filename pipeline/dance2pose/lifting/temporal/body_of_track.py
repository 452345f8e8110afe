"""The body and the keypoints' errors of one dancer, found together.

How sure a projection is of a bone's length depends on how far keypoints err, and how far they err
shows in how much bones of known length seem to vary: each is found from the other, in two rounds.

N frames, J joints, B = J - 1 bones; mm at the size of the one body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.body import Body
from dance2pose.lifting.temporal import keypoint_errors
from dance2pose.lifting.temporal.body_estimate import (
    Measured,
    estimate,
    from_depths,
    from_network,
)
from dance2pose.lifting.temporal.depth import Depth
from dance2pose.lifting.temporal.track_rows import Rows
from dance2pose.poses import FloatArray

_ROUNDS = 2


@dataclass(frozen=True)
class Joints:
    """Where joints are thought to be. xyz and its standard deviation sigma: (N, J, 3) mm."""

    xyz: FloatArray
    sigma: FloatArray

    def scaled(self, factor: float) -> Joints:
        return Joints(self.xyz * factor, self.sigma * factor)


@dataclass(frozen=True)
class Found:
    """body: the dancer's bone lengths. bias_mm: standard deviation of the keypoints' errors that
    last, in either direction of the picture."""

    body: Body
    bias_mm: float


@dataclass(frozen=True)
class BodyMeasurements:
    """All that tells of the body. joints: as seen and predicted together. picture: (N, J, 2) as
    seen, mm. jitter: (N, J) mm. size: (N,) of the network's answer beside them."""

    joints: Joints
    picture: FloatArray
    jitter: FloatArray
    answer: Depth
    size: FloatArray
    seen: Rows

    def bones(self, *, as_seen: bool) -> FloatArray:
        """(N, B, 3) between joints that were seen; as_seen: with the keypoints as they came."""
        parents, children = np.array(self.seen.tree.bones).T
        xyz = self.joints.xyz
        if as_seen:
            xyz = np.concatenate([self.picture, xyz[..., 2:]], axis=-1)
        xyz = np.where(np.isfinite(self.picture).all(axis=-1, keepdims=True), xyz, np.nan)
        return np.asarray(xyz[:, children] - xyz[:, parents])

    def of_both_ends(self, variance: FloatArray) -> FloatArray:
        parents, children = np.array(self.seen.tree.bones).T
        return np.asarray(variance[:, children] + variance[:, parents])


def find_body(measurements: BodyMeasurements) -> tuple[Found, float]:
    """The body and the keypoints' bias, and the size of the poses that tell them."""
    seen = measurements.seen
    predicted = from_network(
        measurements.answer.bones - np.log(measurements.size)[:, None],
        measurements.answer.sigma_bones,
    )
    bias = seen.bias_mm
    for _ in range(_ROUNDS):
        body, unit = estimate(
            [_measured(measurements, bias)], seen.skeleton, seen.body, predicted=predicted
        )
        bias = max(keypoint_bias(measurements, unit * body.lengths_mm) / unit, seen.bias_mm)
    return Found(body, bias), unit


def unit_of(measurements: BodyMeasurements, found: Found) -> float:
    """The size of poses of a known body."""
    measured = _measured(measurements, found.bias_mm)
    off = measured.log_length - np.log(found.body.lengths_mm / measurements.seen.usual_mm)
    known = np.isfinite(off) & np.isfinite(measured.sigma)
    if not known.any():
        return 1.0
    weight = 1 / measured.sigma[known] ** 2
    return float(np.exp((weight * off[known]).sum() / weight.sum()))


def keypoint_bias(measurements: BodyMeasurements, lengths: FloatArray) -> float:
    """Standard deviation of the keypoints' errors that are no jitter."""
    depth_variance = measurements.of_both_ends(np.square(measurements.joints.sigma[..., 2]))
    total = keypoint_errors.of_lengths(measurements.bones(as_seen=True), depth_variance, lengths)
    jitter = float(np.median(measurements.jitter))
    return float(np.sqrt(max(total**2 - jitter**2, 0.0)))


def _measured(measurements: BodyMeasurements, bias_mm: float) -> Measured:
    sigma = measurements.joints.sigma
    return from_depths(
        measurements.bones(as_seen=False),
        measurements.of_both_ends(np.square(sigma[..., 2])),
        measurements.of_both_ends(np.square(sigma[..., 0]) + bias_mm**2),
        measurements.seen.time_s,
        measurements.seen.usual_mm,
    )
