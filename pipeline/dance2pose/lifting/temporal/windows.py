"""Tracks too long to be held in memory as a whole: lifted window by window, with one body.

Lifting holds about 10 KB a frame while it works, a gigabyte for an hour. What it needs to know of
the whole track, the dancer's bones and the keypoints' errors, is found once, in stretches taken
evenly from it. Everything else depends on what is near in time; so windows that overlap agree
where they meet, and each is left for the next at the frame where both agree best.

T frames, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.temporal.body_of_track import Found
from dance2pose.poses import FloatArray, IntArray

# Tracks up to this long, frames, are lifted as a whole: five minutes at 60 a second.
LONGEST_WHOLE = 18_000
WINDOW = 3_000
# What windows have in common, seconds; the first and the last quarter of it are left to the one
# window that also knows what comes before or after.
_OVERLAP_S, _EDGE = 20.0, 0.25
# The stretches that tell the body: so many, of so many frames together.
_STRETCHES, TELLING = 30, 4_500

Find = Callable[[Observed, Found | None], Lifted]


def lift_in_windows(observed: Observed, find: Find) -> Lifted:
    """Poses of a long track, in memory for a window beside the result.

    find: lifts one track, with the body and errors that were found before or, for None, with those
    that it finds. The parts of the errors are not kept.
    """
    told = find(_rows(observed, telling_rows(len(observed))), None)
    if told.body is None or told.errors is None:
        return find(observed, None)  # nothing was seen there
    found = Found(told.body, told.errors.bias_mm)
    frames, joints = observed.confidence.shape
    root = None if told.root is None else np.full((frames, 3), np.nan)
    out = Lifted(
        # Half the memory, for 0.0001 mm and px.
        np.full((frames, joints, 3), np.nan, np.float32),
        np.full((frames, joints, 2), np.nan, np.float32),
        np.full((frames, joints), np.nan, np.float32),
        root,
        found.body,
    )
    before = 0
    for rows in windows(observed.time_s):
        lifted = find(_rows(observed, rows), found)
        _put(lifted, out, rows, slice(rows.start, max(before, rows.start)))
        before = rows.stop
    return out


def telling_rows(frames: int) -> IntArray:
    """Rows of stretches taken evenly from a track."""
    length = TELLING // _STRETCHES
    starts = np.linspace(0, frames - length, _STRETCHES).astype(int)
    return np.unique(starts[:, None] + np.arange(length))


def windows(time_s: FloatArray) -> Iterator[slice]:
    """Rows of windows of about one length, each with what it shares with the one before."""
    frames = len(time_s)
    count = -(-frames // WINDOW)
    edges = [round(frames * part / count) for part in range(count + 1)]
    for start, stop in pairwise(edges):
        low = np.searchsorted(time_s, time_s[start] - _OVERLAP_S / 2) if start else 0
        high = stop
        if stop < frames:
            high = np.searchsorted(time_s, time_s[stop] + _OVERLAP_S / 2)
        yield slice(int(low), int(high))


def _put(lifted: Lifted, out: Lifted, rows: slice, shared: slice) -> None:
    """Write a window's poses from the frame on where they agree best with those before."""
    skip = _meeting(lifted, out, shared)
    to = slice(rows.start + skip, rows.stop)
    out.xyz[to], out.projected[to] = lifted.xyz[skip:], lifted.projected[skip:]
    for mine, theirs in ((out.sigma, lifted.sigma), (out.root, lifted.root)):
        if mine is not None and theirs is not None:
            mine[to] = theirs[skip:]


def _meeting(lifted: Lifted, out: Lifted, shared: slice) -> int:
    """The first frame, counted in the window, that is taken from it."""
    length = shared.stop - shared.start
    if not length:
        return 0
    apart = np.linalg.norm(lifted.xyz[:length] - out.xyz[shared], axis=-1).mean(axis=1)
    if out.root is not None and lifted.root is not None:
        apart += np.linalg.norm(lifted.root[:length] - out.root[shared], axis=-1)
    # Where neither knows a pose nothing jumps; where one does, something would.
    unknown = np.isnan(lifted.xyz[:length]).all(axis=(1, 2))
    unknown &= np.isnan(out.xyz[shared]).all(axis=(1, 2))
    apart = np.where(unknown, 0.0, np.nan_to_num(apart, nan=np.inf))
    edge = int(_EDGE * length)
    return edge + int(np.argmin(apart[edge : length - edge]))


def _rows(observed: Observed, rows: slice | IntArray) -> Observed:
    motion = observed.motion
    if motion is not None:
        motion = motion.at(motion.frame[rows])
    return replace(
        observed,
        xy=observed.xy[rows],
        confidence=observed.confidence[rows],
        time_s=observed.time_s[rows],
        motion=motion,
    )
