"""Paths through uncertain positions that move as bodies do: no lag, any frame times.

The most likely path where positions are known up to a Gaussian error and accelerations are
Gaussian about zero: the smoother of Whittaker (1923), as a Kalman smoother would find it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import solveh_banded

from dance2pose.poses import FloatArray

# mm / s^2, root mean square in dance; slow enough to average noise, quick enough for a turn.
_ACCELERATION = 7000.0
# Nobody moves differently within a millisecond, and shorter steps have no exact solution.
_SHORTEST_STEP_S = 1e-3


def smooth_path(
    values: FloatArray,
    sigma: FloatArray,
    time_s: FloatArray,
    *,
    acceleration: float | None = None,
) -> FloatArray:
    """Smoothed values (T, ...). sigma: of the same shape, the standard deviation of the error that
    changes from frame to frame; acceleration: of the motion, in units of the values per s^2."""
    frames = len(values)
    if frames < 3:
        return values
    acceleration = acceleration or _ACCELERATION
    # Coordinates of a point that err alike have one system; all systems, which nothing couples, are
    # solved as one.
    alike = values.shape[-1] if values.ndim > 1 and sigma.shape[-1:] in ((), (1,)) else 1
    flat = values.reshape(frames, -1, alike).transpose(1, 0, 2)
    sigma = np.broadcast_to(sigma, values.shape).reshape(frames, -1, alike)[..., :1]
    weight = 1.0 / np.square(sigma.transpose(1, 0, 2))
    bands = np.tile(second_difference_bands(time_s) / acceleration**2, len(flat))
    bands[2] += weight.ravel()
    out = solveh_banded(bands, (weight * flat).reshape(-1, alike), overwrite_ab=True)
    return np.asarray(out.reshape(flat.shape).transpose(1, 0, 2).reshape(values.shape))


def frames_averaged(
    sigma: FloatArray, time_s: FloatArray, *, acceleration: float | None = None
) -> FloatArray:
    """Of how many frames' errors (T, ...) a path of `smooth_path` is the mean, at least 1.

    The smoother is a low-pass filter whose corner is where errors and accelerations are alike.
    """
    if len(time_s) < 3:
        return np.ones_like(sigma)
    step = float(np.median(np.diff(time_s)))
    alike = sigma / ((acceleration or _ACCELERATION) * step**2)
    return np.asarray(np.maximum(2 * np.sqrt(2) * np.sqrt(alike), 1.0))


def second_difference_bands(time_s: FloatArray) -> npt.NDArray[np.float64]:
    """Upper bands (3, T) of D' D, where D x is the acceleration of x at the inner frames."""
    steps = np.maximum(np.diff(time_s), _SHORTEST_STEP_S)
    before, after = steps[:-1], steps[1:]
    left = 2.0 / (before * (before + after))
    right = 2.0 / (after * (before + after))
    rows = np.stack([left, -(left + right), right])  # on frames i - 1, i, i + 1
    bands = np.zeros((3, len(time_s)))
    for offset in range(3):  # of the second factor's frame after the first's
        for first in range(3 - offset):
            product = rows[first] * rows[first + offset]
            place = slice(first + offset, first + offset + len(product))
            bands[2 - offset, place] += product
    return bands


def frame_noise(values: FloatArray) -> FloatArray:
    """Standard deviation (J,) of what changes at random from frame to frame of (T, J, D).

    From third differences, in which motion all but vanishes; robust (median), NaN where fewer than
    eight can be formed. Differences across missing values do not count.
    """
    third = values[3:] - 3 * values[2:-1] + 3 * values[1:-2] - values[:-3]
    size = np.abs(third).transpose(1, 0, 2).reshape(values.shape[1], -1)
    known = np.isfinite(size)
    out = np.full(len(size), np.nan)
    for j in np.flatnonzero(known.sum(axis=1) >= 8):
        # 0.6745: the median of |normal|; 20 = 1 + 9 + 9 + 1.
        out[j] = np.median(size[j, known[j]]) / 0.6745 / np.sqrt(20.0)
    return out
