"""Measures of 3D poses against the truth.

Poses are (T, J, 3) in mm, the truth likewise. Frames in which the estimate has a NaN count as not
lifted: they take no part in an average, and `lifted_share` says how many there are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dance2pose.angles import joint_angles
from dance2pose.holes import unbroken
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# A knee or elbow bent by less than this is straight.
STRAIGHT_DEG = 15.0


def lifted(estimate: FloatArray) -> BoolArray:
    """(T,) True where every joint is known."""
    return np.asarray(np.isfinite(estimate).all(axis=(1, 2)))


def procrustes_aligned(
    estimate: FloatArray, truth: FloatArray, *, reflection: bool = False
) -> FloatArray:
    """Each estimated pose moved, turned and scaled to lie closest to its true one (T, J, 3).

    reflection: let it be mirrored as well, as the paper's wording does. Frames with NaN give NaN.
    """
    proper, mirrored = _aligned_both_ways(estimate, truth)
    return mirrored if reflection else proper


def _aligned_both_ways(estimate: FloatArray, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Aligned poses without and with reflection allowed, from one decomposition."""
    proper = np.full(estimate.shape, np.nan)
    rows = lifted(estimate)
    if not rows.any():
        return proper, proper
    mean = truth[rows].mean(axis=1, keepdims=True)
    moving = estimate[rows] - estimate[rows].mean(axis=1, keepdims=True)
    u, singular, vt = np.linalg.svd(moving.transpose(0, 2, 1) @ (truth[rows] - mean))
    size = np.maximum(np.square(moving).sum(axis=(1, 2)), np.finfo(float).tiny)[:, None, None]
    free = proper.copy()
    free[rows] = singular.sum(axis=1)[:, None, None] / size * (moving @ (u @ vt)) + mean
    sign = np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)
    u[:, :, 2] *= sign[:, None]
    singular[:, 2] *= sign
    proper[rows] = singular.sum(axis=1)[:, None, None] / size * (moving @ (u @ vt)) + mean
    return proper, free


def joint_errors(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Distance (T, J) of every joint from its true place; its mean is the MPJPE."""
    distance: FloatArray = np.linalg.norm(estimate - truth, axis=-1)
    distance[~lifted(estimate)] = np.nan
    return distance


def pa_errors(estimate: FloatArray, truth: FloatArray, *, reflection: bool = False) -> FloatArray:
    """Distance (T, J) after Procrustes alignment frame by frame; its mean is the PA-MPJPE."""
    return joint_errors(procrustes_aligned(estimate, truth, reflection=reflection), truth)


def pa_errors_both_ways(estimate: FloatArray, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`pa_errors` without and with reflection, for the price of one."""
    proper, free = _aligned_both_ways(estimate, truth)
    return joint_errors(proper, truth), joint_errors(free, truth)


def mean_over(values: FloatArray | Sequence[FloatArray]) -> FloatArray:
    """The mean (...) over the first axis, NaN left out; NaN where there is nothing else."""
    stacked = np.asarray(values, dtype=np.float64)
    known = np.isfinite(stacked)
    count = known.sum(axis=0)
    total = np.where(known, stacked, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _derivative(xyz: FloatArray, rate_hz: float, order: int) -> FloatArray:
    derivative: FloatArray = np.diff(xyz, n=order, axis=0) * rate_hz**order
    return derivative


def acceleration_error(estimate: FloatArray, truth: FloatArray, rate_hz: float) -> float:
    """Mean distance between estimated and true acceleration, mm/s²; NaN below three frames."""
    return _mean_length(_derivative(estimate, rate_hz, 2) - _derivative(truth, rate_hz, 2))


def jerk(xyz: FloatArray, rate_hz: float) -> float:
    """Mean length of the third derivative, mm/s³; NaN below four frames."""
    return _mean_length(_derivative(xyz, rate_hz, 3))


def _mean_length(vectors: FloatArray) -> float:
    length = np.linalg.norm(vectors, axis=-1)
    known = np.isfinite(length)
    return float(length[known].mean()) if known.any() else float("nan")


def lag_frames(estimate: FloatArray, truth: FloatArray, *, longest: int = 20) -> float:
    """By how many frames the estimate comes late: the peak of the normalised cross-correlation.

    Positive is late. All coordinates count together, each less its mean; a parabola through the
    peak and its neighbours gives fractions. NaN where fewer than 3 `longest` frames in a row are
    lifted, where nothing moves, and where the peak is not within ± `longest` frames.
    """
    rows = _longest_run(lifted(estimate))
    length = rows.stop - rows.start
    if length < 3 * longest:
        return float("nan")
    late = estimate[rows].reshape(length, -1)
    true = _unit_energy(truth[rows].reshape(length, -1)[longest : length - longest])
    correlation = np.array(
        [
            (_unit_energy(late[longest + lag : length - longest + lag]) * true).sum()
            for lag in range(-longest, longest + 1)
        ]
    )
    if not np.isfinite(correlation).all():
        return float("nan")
    peak = int(correlation.argmax())
    if correlation[peak] <= 0 or peak in (0, 2 * longest):
        return float("nan")
    before, at, after = correlation[peak - 1 : peak + 2]
    return float(peak - longest + 0.5 * (before - after) / (before - 2 * at + after))


def _unit_energy(values: FloatArray) -> FloatArray:
    """Values (T, C) less their means, scaled to a sum of squares of one; NaN where constant."""
    moved = values - values.mean(axis=0)
    energy = np.sqrt(np.square(moved).sum())
    return np.asarray(moved / energy if energy > 0 else np.full_like(moved, np.nan))


def _longest_run(flags: BoolArray) -> slice:
    return max(unbroken(flags), key=lambda run: run.stop - run.start, default=slice(0, 0))


def bone_length_range(xyz: FloatArray, skeleton: Skeleton) -> float:
    """The largest difference between the longest and the shortest that any one bone gets, mm."""
    parents, children = np.array(skeleton.bones).T
    known = xyz[lifted(xyz)]
    if not len(known):
        return float("nan")
    lengths = np.linalg.norm(known[:, children] - known[:, parents], axis=-1)
    return float((lengths.max(axis=0) - lengths.min(axis=0)).max())


def within_sigma(errors: FloatArray, sigma: FloatArray) -> tuple[float, float]:
    """Shares of errors (T, J) not larger than one and than two standard deviations (T, J)."""
    known = np.isfinite(errors) & np.isfinite(sigma)
    if not known.any():
        return float("nan"), float("nan")
    ratio = errors[known] / sigma[known]
    return float((ratio <= 1).mean()), float((ratio <= 2).mean())


def flexion_errors(estimate: FloatArray, truth: FloatArray, skeleton: str) -> tuple[float, float]:
    """How wrongly knees and elbows are bent, degrees.

    The mean size of the error of their flexion over frames, and by how much those that are straight
    (bent by less than STRAIGHT_DEG) seem bent further, on average. NaN where there is none.
    """
    found, true = joint_angles(estimate, skeleton), joint_angles(truth, skeleton)
    names = [name for name in true if name.endswith(("knee_flexion", "elbow_flexion"))]
    off = np.stack([found[name] - true[name] for name in names])
    straight = off[np.stack([true[name] for name in names]) < STRAIGHT_DEG]
    return float(mean_over(np.abs(off).ravel())), float(mean_over(straight))


def foot_slide(feet: FloatArray, contact: BoolArray) -> float:
    """How far feet (T, F, 3) move from one frame to the next while both have contact (T, F), mm.

    The mean over the steps between frames; NaN where no foot stands.
    """
    moved = np.linalg.norm(np.diff(feet, axis=0), axis=-1)
    standing = contact[1:] & contact[:-1] & np.isfinite(moved)
    return float(moved[standing].mean()) if standing.any() else float("nan")


def true_contacts(
    feet: FloatArray, rate_hz: float, *, slowest_mm_s: float = 150.0, above_mm: float = 60.0
) -> BoolArray:
    """Which feet (T, F, 3), y up, stand in a true motion: slow, and near the lowest they get."""
    speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1) * rate_hz
    lowest = np.quantile(feet[..., 1], 0.02)
    standing: BoolArray = (speed < slowest_mm_s) & (feet[..., 1] < lowest + above_mm)
    return standing


def signal_to_noise_sigma(xy: FloatArray, snr_db: float) -> float:
    """Standard deviation of Gaussian noise for a ratio of 10 log10(P_signal / P_noise).

    xy: (T, J, 2), centred on the hip; the power of the signal is the mean square of its
    coordinates without the hip, which is always 0.
    """
    power = float(np.mean(np.square(xy[:, 1:])))
    return float(np.sqrt(power / 10 ** (snr_db / 10)))
