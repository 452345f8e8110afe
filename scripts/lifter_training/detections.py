"""How detectors see joints: noise, errors that last, sides confused, joints missing.

B clips, T frames, J joints of cmu17 or body17; mm at the dancer's size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.lifting.temporal.network import JOINTS, RATE_HZ
from dance2pose.poses import BoolArray, FloatArray

_ROOT, _HEAD, _HIPS, _TOES = 0, 8, [9, 13], [12, 16]
_LEGS = [9, 10, 11, 12, 13, 14, 15, 16]
_LIMBS = ([3, 4], [6, 7], [10, 11, 12], [14, 15, 16], [2, 3, 4], [5, 6, 7])
# How far each joint's detections scatter relative to the average: wrists and ankles most.
_SCATTER = np.array([0.9, 0.8, 0.9, 1.1, 1.4, 0.9, 1.1, 1.4, 0.8] + [0.9, 1.0, 1.2, 1.3] * 2)
_SCATTER = (_SCATTER / np.sqrt(np.mean(_SCATTER**2))).astype(np.float32)
# Slow errors last this long, s, and are this large at most, mm.
_LASTING_S, _MOST_SLOW_MM, _MOST_WHITE_MM = (0.3, 3.0), 25.0, 16.0


@dataclass(frozen=True)
class Noise:
    """offset: (B, T, J, 2) mm. confidence: (B, T, J), which tells a part of it. level: (B,) mm,
    standard deviation of the errors that no average over frames mends."""

    offset: FloatArray
    confidence: FloatArray
    level: FloatArray


def noise(shape: tuple[int, ...], length: int, rng: np.random.Generator) -> Noise:
    """Errors of clips of `length` frames, followed by frames from elsewhere in the same takes."""
    count = shape[0]
    # Nothing tells the noise of a single picture, so that a network that often sees noisy ones
    # hedges on clean ones; in clips it shows.
    single = length == 1
    clean = rng.random(count) < 0.25
    white = _level(count, 0.7 if single else 0.35, _MOST_WHITE_MM, rng) * ~clean
    slow = _level(count, 0.5 if single else 0.4, _MOST_SLOW_MM, rng) * ~clean
    lasting = _lasting(shape, length, rng) * _SCATTER[:, None] * slow[:, None, None, None]
    offset = rng.standard_normal(shape, np.float32) * white[:, None, None, None] + lasting
    worse = rng.random(shape[:3]) < (0.06 * (rng.random(count) < 0.3) * ~clean)[:, None, None]
    told = (rng.random(count) < 0.6)[:, None, None]
    confidence = np.where(worse & told, rng.uniform(0.2, 0.8, shape[:3]), 1.0)
    offset[worse] += 60 * rng.standard_normal((int(worse.sum()), 2), np.float32)
    return Noise(np.asarray(offset), confidence, np.hypot(slow, white) if single else slow)


def _level(count: int, clean: float, most: float, rng: np.random.Generator) -> FloatArray:
    """Standard deviations (B,) mm, a part of them zero."""
    some = rng.random(count) >= clean
    return np.asarray(some * rng.uniform(0, most, count), np.float32)


def _lasting(shape: tuple[int, ...], length: int, rng: np.random.Generator) -> FloatArray:
    """Errors of unit variance: an Ornstein-Uhlenbeck process, and a bias that a clip keeps."""
    count = shape[0]
    out = rng.standard_normal(shape, np.float32)
    seconds = np.exp(rng.uniform(*np.log(_LASTING_S), (count, 1, 1)))
    keep = np.exp(-1 / (RATE_HZ * seconds)).astype(np.float32)
    new = np.sqrt(1 - keep**2)
    for t in range(1, length):
        out[:, t] = keep * out[:, t - 1] + new * out[:, t]
    kept = rng.uniform(0, 0.6, (count, 1, 1, 1)).astype(np.float32)
    bias = rng.standard_normal((count, 1, *shape[2:]), np.float32)
    return np.asarray(np.sqrt(1 - kept) * out + np.sqrt(kept) * bias)


def swapped_sides(xy: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Left and right legs or arms confused for a few frames, in one clip of twelve."""
    count, frames = xy.shape[:2]
    for b in np.flatnonzero(rng.random(count) < 0.08):
        start = int(rng.integers(0, frames))
        left, right = (
            ([9, 10, 11, 12], [13, 14, 15, 16]) if rng.random() < 0.6 else ([2, 3, 4], [5, 6, 7])
        )
        run = slice(start, start + int(rng.integers(1, 6)))
        xy[b, run] = xy[b, run][:, _swap_order(left, right)]
    return xy


def _swap_order(left: list[int], right: list[int]) -> list[int]:
    order = list(range(JOINTS))
    for a, b in zip(left, right, strict=True):
        order[a], order[b] = b, a
    return order


def visible(shape: tuple[int, ...], body: BoolArray, rng: np.random.Generator) -> BoolArray:
    """Which joints (B, T, J) are seen: runs of missing joints, whole limbs, legs, toes, heads."""
    count, frames, joints = shape
    seen = np.ones(shape, bool)
    share = np.where(rng.random(count) < 0.4, rng.uniform(0, 0.3, count), 0.0)
    longest = rng.choice([6, 12, 24], count)
    mean_run = (2 + longest) / 2
    begins = rng.random(shape) < (share / mean_run)[:, None, None]
    run = rng.integers(2, np.maximum(longest, 3)[:, None, None], shape)
    left = np.zeros((count, joints), int)
    for t in range(frames):
        left = np.where(begins[:, t], run[:, t], left - 1)
        seen[:, t] &= left <= 0
    if frames <= 2:  # single pictures: joints are simply not there
        seen &= rng.random(shape) >= share[:, None, None]
    for b in np.flatnonzero(rng.random(count) < 0.05):  # half-body shots
        seen[b, :, [j for j in _LEGS if j not in _HIPS or rng.random() < 0.4]] = False
        if not seen[b, :, _HIPS].any():
            seen[b, :, _ROOT] = rng.random() < 0.3
    for b in np.flatnonzero(rng.random(count) < 0.05):
        seen[b, :, _LIMBS[rng.integers(len(_LIMBS))]] = False
    toeless = rng.random(count) < np.where(body, 0.75, 0.15)
    seen[np.ix_(toeless, np.arange(frames), _TOES)] = False
    seen[rng.random(count) < 0.05, :, _HEAD] = False
    hipless = body & ~seen[:, :, _HIPS].all(axis=(1, 2))  # body17's midpoints need both sides
    seen[hipless, :, _ROOT] &= seen[hipless][:, :, _HIPS].all(axis=-1)
    return seen
