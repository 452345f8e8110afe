"""Two performances set against each other: aligned in time, then compared joint by joint.

Both are looked at relative to the body: the pelvis at the origin, turned about the vertical so that
hips and shoulders face forward, the second scaled to the size of the first (trunk and legs). On an
even clock of 25 a second (less for very long takes) dynamic time warping finds the monotone
matching of moments with the least mean distance of joints; beginnings match and ends match, a step
in both performances counts twice (the symmetric form of Sakoe and Chiba 1978), and no moment is
matched with one that lies further away than a fifth of the whole (their band).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dance2pose.body import bone_lengths
from dance2pose.errors import DataError, UsageError
from dance2pose.even_rate import Times, even
from dance2pose.holes import holes
from dance2pose.phrases import find_phrases
from dance2pose.poses import FloatArray, Track3D, Unit
from dance2pose.skeleton import Skeleton, get

RATE_HZ = 25.0
BAND = 0.2
# What a matching may cost: about a minute, and 0.1 GB.
_MAX_CELLS = 60_000_000
_FEWEST = 10


@dataclass(frozen=True)
class Difference:
    """One joint over one phrase: mean and largest distance in the unit of the first performance."""

    joint: str
    mean: float
    largest: float


@dataclass(frozen=True)
class PhraseDifference:
    """A phrase of the first performance and what matches it in the second.

    number: from 1, or 0 for the whole. a_s, b_s: start and end, s. tempo: how much longer the
    second takes (2 is twice as long); NaN for a phrase of no length. joints: differences, that of
    all joints together (named "all") first.
    """

    number: int
    a_s: tuple[float, float]
    b_s: tuple[float, float]
    tempo: float
    joints: tuple[Difference, ...]


@dataclass(frozen=True)
class Comparison:
    """Two performances on the frames of the first.

    time_s: (T,) of the first; time_b_s: (T,) of the moments of the second that match, NaN where
    none does. a, b: (T, J, 3) body-relative joints, in `unit`. distance: (T, J). phrases: the
    whole first, then phrase by phrase.
    """

    skeleton: Skeleton
    unit: Unit
    frame: npt.NDArray[np.int64]
    time_s: Times
    time_b_s: Times
    a: FloatArray
    b: FloatArray
    distance: FloatArray
    phrases: tuple[PhraseDifference, ...]


def compare(first: Track3D, second: Track3D) -> Comparison:
    """Align two performances in time and measure how their joints differ.

    Raises UsageError for different skeletons, DataError where too few frames have a pose.

    >>> compare(teacher, student).phrases[0].joints[0].mean  # doctest: +SKIP
    """
    if first.skeleton != second.skeleton:
        raise UsageError(
            f"the performances have different skeletons, {first.skeleton} and {second.skeleton}"
        )
    for track, which in ((first, "first"), (second, "second")):
        if np.isnan(track.xyz).any(axis=2).all():
            raise DataError(f"the {which} performance has no pose")
    skeleton = get(first.skeleton)
    a, b = (body_relative(track.xyz, skeleton) for track in (first, second))
    size_a, size_b = (_size(track.xyz, skeleton) for track in (first, second))
    b = b * (size_a / size_b)
    time_b_s = _matching_times(first, a, second, b)
    matched = _at_times(second, b, time_b_s)
    distance: FloatArray = np.linalg.norm(a - matched, axis=2)
    phrases = _phrase_differences(first, time_b_s, distance, skeleton)
    return Comparison(
        skeleton, first.unit, first.frame, first.time_s, time_b_s, a, matched, distance, phrases
    )


def body_relative(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Joints (T, J, 3) about the pelvis, turned about the vertical so that the body faces +z.

    Forward is square to the lines of hips and shoulders together, seen from above; where these
    stand upright or are missing, the last known direction counts.
    """
    line = np.zeros((len(xyz), 2))
    for part in ("hip", "shoulder"):
        left, right = skeleton.index(f"left_{part}"), skeleton.index(f"right_{part}")
        line += (xyz[:, left] - xyz[:, right])[:, [0, 2]]
    angle = np.arctan2(line[:, 1], line[:, 0])  # of the left side, from x towards z
    known = np.isfinite(angle) & (np.linalg.norm(line, axis=1) > 1e-6)
    rows = np.where(known, np.arange(len(xyz)), -1)
    last = np.maximum.accumulate(rows)
    angle = np.where(last >= 0, angle[np.maximum(last, 0)], 0.0)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    centred = xyz - xyz[:, :1]
    x, y, z = np.moveaxis(centred, -1, 0)
    return np.stack([c * x + s * z, y, -s * x + c * z], axis=-1)


def match(a: FloatArray, b: FloatArray, *, band: float = BAND) -> npt.NDArray[np.int64]:
    """The path of dynamic time warping (L, 2) between (N, J, 3) and (M, J, 3): rows that match.

    Computed one anti-diagonal of the table after another.
    """
    n, m = len(a), len(b)
    width = max(band, 1.5 / max(min(n, m) - 1, 1))
    share_a, share_b = np.linspace(0, 1, n), np.linspace(0, 1, m)
    before = np.full(n + 1, np.inf)  # costs of a diagonal; entry i + 1 is row i
    before_that = before.copy()
    steps: list[tuple[int, npt.NDArray[np.int8]]] = []
    for k in range(n + m - 1):
        i = np.arange(max(0, k - m + 1), min(n, k + 1))
        i = i[np.abs(share_a[i] - share_b[k - i]) <= width]
        here = np.full(n + 1, np.inf)
        if len(i):
            cost = np.linalg.norm(a[i] - b[k - i], axis=2).mean(axis=1)
            ways = np.stack([before_that[i] + 2 * cost, before[i] + cost, before[i + 1] + cost])
            if k == 0:
                ways[0] = cost
            step = ways.argmin(axis=0).astype(np.int8)
            here[i + 1] = ways[step, np.arange(len(i))]
            steps.append((int(i[0]), step))
        else:
            steps.append((0, np.zeros(0, np.int8)))
        before_that, before = before, here
    return _walk_back(n, m, steps)


def _walk_back(
    n: int, m: int, steps: list[tuple[int, npt.NDArray[np.int8]]]
) -> npt.NDArray[np.int64]:
    i, j = n - 1, m - 1
    path = [(i, j)]
    while i or j:
        first, step = steps[i + j]
        way = int(step[i - first])
        i, j = (i - 1, j - 1) if way == 0 else (i - 1, j) if way == 1 else (i, j - 1)
        path.append((i, j))
    return np.array(path[::-1])


def _size(xyz: FloatArray, skeleton: Skeleton) -> float:
    """Length of trunk and legs together."""
    lengths = bone_lengths(xyz, skeleton)
    ends = [skeleton.joints[1]]
    ends += [f"{side}_{joint}" for side in ("left", "right") for joint in ("knee", "ankle")]
    return float(sum(lengths[skeleton.index(end) - 1] for end in ends))


def _matching_times(first: Track3D, a: FloatArray, second: Track3D, b: FloatArray) -> Times:
    """The time of b (T,) that matches each time of a, NaN in its gaps."""
    rate = RATE_HZ
    cells = np.ptp(first.time_s) * np.ptp(second.time_s) * rate**2 * min(1.0, 2 * BAND)
    if cells > _MAX_CELLS:
        rate *= float(np.sqrt(_MAX_CELLS / cells))
    ticks_a, known_a = _known_ticks(first, a, rate, "first")
    ticks_b, known_b = _known_ticks(second, b, rate, "second")
    path = match(known_a, known_b)
    matched = np.array([ticks_b[path[path[:, 0] == i, 1]].mean() for i in range(len(ticks_a))])
    times: Times = np.interp(first.time_s, ticks_a, matched)
    times[np.isnan(a).all(axis=(1, 2))] = np.nan
    return times


def _known_ticks(
    track: Track3D, xyz: FloatArray, rate: float, which: str
) -> tuple[Times, FloatArray]:
    """The ticks that have a whole pose: their times and joints."""
    motion = even(track.time_s, xyz, rate, frame=track.frame)
    joints = np.asarray(~np.isnan(motion.xyz).any(axis=2))
    usual = joints.any(axis=0)  # a joint that is never known takes no part
    known = joints[:, usual].all(axis=1)
    if known.sum() < _FEWEST:
        raise DataError(
            f"the {which} performance has {known.sum()} moments with a whole pose at {rate:.3g} a "
            f"second, expected {_FEWEST} or more"
        )
    return motion.time_s[known], np.nan_to_num(motion.xyz[known])


def _at_times(track: Track3D, xyz: FloatArray, at: Times) -> FloatArray:
    """Joints (T, J, 3) of a track at other times, NaN in its holes."""
    time_s = track.time_s
    after = np.clip(np.searchsorted(time_s, np.nan_to_num(at)), 1, max(len(time_s) - 1, 1))
    share = np.clip((at - time_s[after - 1]) / (time_s[after] - time_s[after - 1]), 0, 1)
    found: FloatArray = xyz[after - 1] + share[:, None, None] * (xyz[after] - xyz[after - 1])
    found[holes(time_s, track.frame)[after - 1]] = np.nan
    return found


def _phrase_differences(
    first: Track3D, time_b_s: Times, distance: FloatArray, skeleton: Skeleton
) -> tuple[PhraseDifference, ...]:
    whole = (0, float(first.time_s[0]), float(first.time_s[-1]))
    spans = [whole, *((p.number, p.start_s, p.end_s) for p in find_phrases(first))]
    found = []
    for number, start, end in spans:
        rows = np.flatnonzero((first.time_s >= start) & (first.time_s <= end))
        rows = rows[~np.isnan(time_b_s[rows])]
        if not len(rows):
            continue
        a_s = (float(first.time_s[rows[0]]), float(first.time_s[rows[-1]]))
        b_s = (float(time_b_s[rows[0]]), float(time_b_s[rows[-1]]))
        tempo = (b_s[1] - b_s[0]) / (a_s[1] - a_s[0]) if a_s[1] > a_s[0] else float("nan")
        joints = _differences(distance[rows], skeleton.joints)
        found.append(PhraseDifference(number, a_s, b_s, tempo, joints))
    return tuple(found)


def _differences(distance: FloatArray, joints: Sequence[str]) -> tuple[Difference, ...]:
    """Mean and largest over (T, J), the pelvis left out: it is at the origin in both."""
    columns = [("all", distance[:, 1:].ravel())]
    columns += [(joint, distance[:, j]) for j, joint in enumerate(joints) if j]
    found = []
    for name, values in columns:
        values = values[~np.isnan(values)]
        if len(values):
            found.append(Difference(name, float(values.mean()), float(values.max())))
    return tuple(found)
