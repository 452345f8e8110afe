"""Short gaps in a sequence of keypoints, filled linearly in time; long ones stay gaps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dance2pose.poses import BoolArray, FloatArray

_ROUNDING_S = 1e-6  # timestamps are rounded in the file


def fill_gaps(
    xy: FloatArray, time_s: npt.NDArray[np.float64], *, longest_s: float
) -> tuple[FloatArray, BoolArray]:
    """Fill the gaps of every keypoint that are short enough, linearly in time.

    xy: (T, J, 2) px, NaN where missing. time_s: (T,). A gap is filled where no more than
    `longest_s` seconds lie between the two sights around it; nothing is filled before the first
    or after the last sight. Returns a new xy and a (T, J) mask of what was filled.
    """
    seen = np.isfinite(xy).all(axis=2)
    rows = np.arange(len(xy))[:, np.newaxis]
    before = np.maximum.accumulate(np.where(seen, rows, -1), axis=0)
    after = np.minimum.accumulate(np.where(seen, rows, len(xy))[::-1], axis=0)[::-1]
    gap = ~seen & (before >= 0) & (after < len(xy))
    row, joint = np.nonzero(gap)
    start, end = before[row, joint], after[row, joint]
    duration = time_s[end] - time_s[start]
    short = duration <= longest_s + _ROUNDING_S
    row, joint, start, end = row[short], joint[short], start[short], end[short]
    # Frames of one and the same time: any share is right, and 0/0 must not arise.
    share = (time_s[row] - time_s[start]) / np.maximum(duration[short], _ROUNDING_S)
    filled_xy, filled = xy.copy(), np.zeros(seen.shape, np.bool_)
    step = xy[end, joint] - xy[start, joint]
    filled_xy[row, joint] = xy[start, joint] + share[:, np.newaxis] * step
    filled[row, joint] = True
    return filled_xy, filled
