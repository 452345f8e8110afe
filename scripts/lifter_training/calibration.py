"""Factors that turn the lifter's scales of error into standard deviations.

A standard deviation here means: the distance of a joint from the truth, the first joints together
and nothing else aligned, is less than sigma in about 68 % of cases. Fitted on takes that were not
trained on, a part of the cases each with clean keypoints, with noise, with missing joints, and as
single pictures. The factors are a little wide, since errors have longer tails than a normal
distribution: both one and two sigma then hold about as often as they should.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.lifting.lifted import Observed
from dance2pose.lifting.temporal.sequence import lift_frames
from dance2pose.mocap.corpus import Take
from dance2pose.poses import FloatArray

_RATE_HZ = 30.0
_LONGEST = 300  # frames of a take
_WITHIN = 0.70


def sigma_factors(takes: Iterable[Take], rng: np.random.Generator) -> FloatArray:
    """(J,) factors, with the lifter as it is installed but its own factors taken out."""
    ratios = []
    for take in takes:
        xyz = take.xyz[:: max(1, round(take.rate_hz / _RATE_HZ))][:_LONGEST].astype(float)
        angles = [rng.uniform(0, 360), rng.uniform(-20, 20)]
        seen = xyz @ Rotation.from_euler("yx", angles, degrees=True).as_matrix().T
        for observed in _conditions(seen[..., :2], rng):
            lifted = lift_frames(observed)
            assert lifted.sigma is not None
            off = lifted.xyz - lifted.xyz[:, :1] - (seen - seen[:, :1])
            ratios.append(np.linalg.norm(off, axis=-1) / lifted.sigma)
    factors = np.quantile(np.concatenate(ratios), _WITHIN, axis=0)
    factors[0] = factors[1:].min()  # the first joint is the origin: it has no error to learn from
    return np.asarray(factors)


def _conditions(xy: FloatArray, rng: np.random.Generator) -> Iterator[Observed]:
    for points, independent in (
        (xy, False),
        (xy + rng.normal(0, 10, xy.shape), False),
        (with_runs_missing(xy, 0.15, rng), False),
        (xy, True),
    ):
        yield Observed(
            xy=points,
            confidence=np.isfinite(points).all(axis=-1).astype(float),
            time_s=np.arange(len(xy)) / _RATE_HZ,
            skeleton="cmu17",
            image_size=(1920, 1080),
            independent=independent,
        )


def with_runs_missing(xy: FloatArray, share: float, rng: np.random.Generator) -> FloatArray:
    """(T, J, 2) with that share of the joints gone, in runs of 5 to 20 frames."""
    frames, joints = xy.shape[:2]
    gone = np.zeros((frames, joints), bool)
    while gone.mean() < share:
        start = int(rng.integers(-10, frames))
        gone[max(start, 0) : start + int(rng.integers(5, 21)), rng.integers(joints)] = True
    return np.where(gone[..., None], np.nan, xy)


def joint_errors(xyz: FloatArray, truth: FloatArray) -> FloatArray:
    """Errors (N, J) of (N, J, 3) after similarity alignment without reflection."""
    x = xyz - xyz.mean(axis=1, keepdims=True)
    y = truth - truth.mean(axis=1, keepdims=True)
    u, s, vt = np.linalg.svd(np.einsum("nji,njk->nik", x, y))
    sign = np.sign(np.linalg.det(u @ vt))
    s[:, 2] *= sign
    u[:, :, 2] *= sign[:, None]
    factor = s.sum(axis=1) / np.square(x).sum(axis=(1, 2))
    fitted = factor[:, None, None] * np.einsum("nji,nik->njk", x, u @ vt)
    return np.asarray(np.linalg.norm(fitted - y, axis=-1))
