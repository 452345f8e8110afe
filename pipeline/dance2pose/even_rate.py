"""Time for forms that know only a frame rate: positions on an even clock, holes kept.

The clock ticks at whole multiples of 1/rate seconds from the start of the video, so that the
number of a tick tells its time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from dance2pose.errors import DataError
from dance2pose.holes import holes
from dance2pose.poses import BoolArray, FloatArray, IntArray

Times = npt.NDArray[np.float64]

# Rates that cameras have. A measured rate this near to one of them is that one.
_NOMINAL = (
    *(12.5, 15.0, 24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0),
    *(rate * 1000 / 1001 for rate in (24, 30, 48, 60, 120, 240)),
)
_SAME_RATE = 3e-4
# How far a tick may lie outside a run of frames and still take its end, in steps.
_SLACK = 0.01
# A spline needs so many points; fewer are joined by lines.
_LEAST_FOR_SPLINE = 4
# A day at 24 frames a second; what needs more ticks than this has wrong times.
MAX_TICKS = 2_100_000


@dataclass(frozen=True)
class EvenMotion:
    """Positions at an even rate.

    rate: ticks a second. first: number of the first tick; tick n is at n / rate seconds.
    xyz: (T, J, 3), NaN in holes and where a joint is missing.
    """

    rate: float
    first: int
    xyz: FloatArray

    @property
    def tick(self) -> npt.NDArray[np.int64]:
        return np.arange(self.first, self.first + len(self.xyz), dtype=np.int64)

    @property
    def time_s(self) -> Times:
        """(T,) seconds from the start of the video."""
        return self.tick / self.rate


def step_s(time_s: Times) -> float:
    """The usual time between two frames; 1/30 s where there is only one."""
    steps = np.diff(time_s)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 1 / 30


def frame_rate(time_s: Times) -> float:
    """Frames a second over the whole of `time_s` without its holes, as a camera would name it."""
    steps = np.diff(time_s)
    usual = steps[(steps > 0) & (steps < 1.5 * step_s(time_s))]
    measured = 1 / float(usual.mean()) if len(usual) else 30.0
    nearest = min(_NOMINAL, key=lambda rate: abs(rate - measured))
    if abs(nearest / measured - 1) < _SAME_RATE:
        return nearest
    return round(measured, 4) if measured > 1 else float(f"{measured:.4g}")


def even(
    time_s: Times, xyz: FloatArray, rate: float | None = None, *, frame: IntArray | None = None
) -> EvenMotion:
    """Positions (T, J, 3) at times (T,) s, on the even clock of `rate` (their own if None).

    Between frames a cubic spline through the run of frames that have the joint. Nothing is made
    up in holes: of time (told better with the frame numbers (T,), see `holes`), or of a joint.

    Raises DataError where the times would need more than `MAX_TICKS` ticks.
    """
    rate = rate or frame_rate(time_s)
    slack = _SLACK
    first = int(np.ceil(time_s[0] * rate - slack))
    last = max(first, int(np.floor(time_s[-1] * rate + slack)))
    if last - first >= MAX_TICKS:
        raise DataError(
            f"frames from {time_s[0]:g} to {time_s[-1]:g} s would make {last - first + 1} at an "
            f"even {rate:g} a second, more than {MAX_TICKS}; are the times seconds?"
        )
    ticks = np.arange(first, last + 1) / rate
    out = np.full((len(ticks), *xyz.shape[1:]), np.nan)
    cuts = holes(time_s, frame)
    for joints, known in _alike(_seen(xyz)):
        for run in _runs(known, cuts):
            times = time_s[run]
            inside = (ticks >= times[0] - slack / rate) & (ticks <= times[-1] + slack / rate)
            at = np.clip(ticks[inside], times[0], times[-1])
            out[np.ix_(inside, joints)] = _between(times, xyz[run][:, joints], at)
    return EvenMotion(rate, first, out)


def bridged(time_s: Times, xyz: FloatArray) -> FloatArray:
    """Positions (T, J, 3) with every hole filled by a straight line, for forms without gaps.

    A joint holds still before its first frame and after its last; one that is never known stays
    NaN.
    """
    out = xyz.copy()
    for joints, known in _alike(_seen(xyz)):
        if known.all() or not known.any():
            continue
        for joint in joints:
            for axis in range(3):
                seen = xyz[known, joint, axis]
                out[:, joint, axis] = np.interp(time_s, time_s[known], seen)
    return out


def is_known(xyz: FloatArray) -> BoolArray:
    """(T,) whether a row has any joint at all."""
    return np.asarray(~np.isnan(xyz).all(axis=(1, 2)))


def _seen(xyz: FloatArray) -> BoolArray:
    """(T, J) whether a joint is known."""
    return np.asarray(~np.isnan(xyz).any(axis=2))


def runs(
    time_s: Times, known: BoolArray, frame: IntArray | None = None
) -> Iterator[npt.NDArray[np.int64]]:
    """The rows of each stretch of known frames without a hole in time (see `holes`)."""
    return _runs(known, holes(time_s, frame))


def _runs(known: BoolArray, cuts: BoolArray) -> Iterator[npt.NDArray[np.int64]]:
    """cuts: (T - 1,) whether a hole lies between a row and the next."""
    rows = np.flatnonzero(known)
    stretch = np.concatenate([[0], np.cumsum(cuts)])
    apart = (np.diff(rows) > 1) | (np.diff(stretch[rows]) > 0)
    for run in np.split(rows, np.flatnonzero(apart) + 1):
        if len(run):
            yield run


def _alike(known: BoolArray) -> Iterator[tuple[npt.NDArray[np.int64], BoolArray]]:
    """Joints (columns) that are known in the same rows, and those rows."""
    patterns, place = np.unique(known, axis=1, return_inverse=True)
    for i in range(patterns.shape[1]):
        yield np.flatnonzero(place.ravel() == i), patterns[:, i]


def _between(times: Times, xyz: FloatArray, at: Times) -> FloatArray:
    if len(times) == 1:
        return np.broadcast_to(xyz[0], (len(at), *xyz.shape[1:]))
    if len(times) >= _LEAST_FOR_SPLINE:
        spline: FloatArray = CubicSpline(times, xyz, axis=0)(at)
        return spline
    after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    share = (at - times[after - 1]) / (times[after] - times[after - 1])
    line: FloatArray = xyz[after - 1] + share[:, None, None] * (xyz[after] - xyz[after - 1])
    return line
