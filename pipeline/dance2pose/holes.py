"""Holes in time: rows that are absent, frames that are missing and timestamps that jump are one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

# A step longer than this many usual ones is a hole: one absent row makes two.
_LONG = 1.5
# Videos of a variable rate have steps of several lengths. Up to this multiple of the median,
# what at least a tenth of the steps are as long as is usual.
_MOST_USUAL = 4.0
_OFTEN = 0.9
# Where frames are numbered without a break, a picture may be shown longer than others; longer
# than this it is a hole all the same.
_LONGEST_PICTURE_S = 0.25


def usual_step(clock: npt.ArrayLike) -> float:
    """The longest step between neighbours that is still usual; 0 where time stands still.

    clock: (T,) seconds or frame numbers that do not run backwards.
    """
    # By hand, as it is asked for in every frame: NumPy's median and percentile take ten times as
    # long for a few steps.
    times = np.asarray(clock, dtype=np.float64)
    steps = times[1:] - times[:-1]
    ordered = np.sort(steps[steps > 0])
    count = len(ordered)
    if not count:
        return 0.0
    median = float(ordered[(count - 1) // 2] + ordered[count // 2]) / 2
    often = float(ordered[int((count - 1) * _OFTEN)])
    return max(median, min(often, _MOST_USUAL * median))


def holes(
    time_s: npt.ArrayLike | None, frame: npt.ArrayLike | None = None
) -> npt.NDArray[np.bool_]:
    """(T - 1,) True where a hole lies between a row and the next.

    time_s: (T,) seconds that do not run backwards. frame: (T,) frame numbers that do not
    decrease; where they are given they tell absent rows, and time only jumps that are long in
    seconds. At least one of the two is needed.

    >>> holes([0.0, 0.1, 0.2, 0.4, 0.5]).tolist()
    [False, False, True, False]
    """
    if frame is None:
        if time_s is None:
            raise ValueError("holes are told by times or by frame numbers; neither is given")
        return _long_steps(time_s, 0.0)
    found = _long_steps(frame, 0.0)
    return found if time_s is None else found | _long_steps(time_s, _LONGEST_PICTURE_S)


def unbroken(flags: npt.NDArray[np.bool_]) -> list[slice]:
    """The runs of True in (T,) flags, in order.

    >>> unbroken(np.array([True, True, False, True]))
    [slice(0, 2, None), slice(3, 4, None)]
    """
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return [slice(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _long_steps(clock: npt.ArrayLike, least: float) -> npt.NDArray[np.bool_]:
    steps = np.diff(np.asarray(clock, dtype=np.float64))
    return np.asarray(steps > max(_LONG * usual_step(clock), least))
