"""Key poses and phrases of a dance, from where its motion comes to rest.

Motion energy is the mean over joints of the squared speed, in squared body heights (or metres) a
second squared: of joints on the dancer's path where that is known, else about the pelvis. Smoothed
with a Gaussian of 0.15 s, its minima are key poses; smoothed with one of 0.4 s, its minima divide
phrases. A minimum counts where the energy falls to half of what it rises to on both sides; before
the first frame and after the last it counts as high. A hole in time, or a frame without a pose,
ends a phrase.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from dance2pose.even_rate import even, runs
from dance2pose.poses import FloatArray, Track3D

# All of these were chosen by eye on one clip.
KEY_POSE_SMOOTHING_S = 0.15
KEY_POSE_DROP = 2.0
KEY_POSE_APART_S = 0.4
PHRASE_SMOOTHING_S = 0.4
PHRASE_DROP = 2.0
SHORTEST_PHRASE_S = 1.5


@dataclass(frozen=True)
class KeyPose:
    """A moment of rest: its frame, its time and its energy (squared units a second squared)."""

    frame: int
    time_s: float
    energy: float


@dataclass(frozen=True)
class Phrase:
    """A stretch of motion between two rests, numbered from 1, and its key poses.

    start_s, end_s: s; the end of one is the start of the next where no hole lies between. energy:
    mean over the phrase.
    """

    number: int
    start_s: float
    end_s: float
    energy: float
    key_poses: tuple[KeyPose, ...]


def find_phrases(track: Track3D) -> tuple[Phrase, ...]:
    """The phrases of one dancer in order of time.

    >>> [phrase.start_s for phrase in find_phrases(track)]  # doctest: +SKIP
    """
    found: list[Phrase] = []
    places = track.world_xyz
    usual = np.asarray(~np.isnan(places).any(axis=2))
    known = usual.sum(axis=1) > usual.shape[1] / 2
    for run in runs(track.time_s, known, track.frame):
        if len(run) < 3:
            continue
        energy = motion_energy(track.time_s[run], places[run])
        for start, end in _phrase_bounds(track.time_s[run], energy):
            found.append(_phrase(len(found) + 1, track, run, energy, start, end))
    return tuple(found)


def motion_energy(time_s: npt.NDArray[np.float64], places: FloatArray) -> FloatArray:
    """(T,) mean squared speed of the joints (T, J, 3) at times (T,) s, T at least 2.

    Joints that are missing in a frame take no part there.
    """
    speed = np.gradient(places, time_s, axis=0)
    squared = (speed**2).sum(axis=2)
    present = ~np.isnan(squared)
    count = present.sum(axis=1)
    energy = np.where(present, squared, 0).sum(axis=1) / np.maximum(count, 1)
    rows = np.arange(len(energy))
    some = count > 0
    filled: FloatArray = (
        np.interp(rows, rows[some], energy[some]) if some.any() else np.zeros(len(energy))
    )
    return filled


def _phrase(
    number: int,
    track: Track3D,
    run: npt.NDArray[np.int64],
    energy: FloatArray,
    start: int,
    end: int,
) -> Phrase:
    times = track.time_s[run]
    part = slice(start, end + 1)
    poses = tuple(
        KeyPose(int(track.frame[run[i]]), float(times[i]), float(energy[i]))
        for i in _minima(times, energy, KEY_POSE_SMOOTHING_S, KEY_POSE_DROP, KEY_POSE_APART_S)
        if start <= i < end or i == end == len(run) - 1
    )
    return Phrase(number, float(times[start]), float(times[end]), float(energy[part].mean()), poses)


def _phrase_bounds(time_s: npt.NDArray[np.float64], energy: FloatArray) -> list[tuple[int, int]]:
    inner = _minima(time_s, energy, PHRASE_SMOOTHING_S, PHRASE_DROP, SHORTEST_PHRASE_S)
    long_enough = [
        i for i in inner if min(time_s[i] - time_s[0], time_s[-1] - time_s[i]) >= SHORTEST_PHRASE_S
    ]
    bounds = [0, *long_enough, len(time_s) - 1]
    return list(pairwise(bounds))


def _minima(
    time_s: npt.NDArray[np.float64],
    energy: FloatArray,
    smoothing_s: float,
    drop: float,
    apart_s: float,
) -> list[int]:
    """Rows of the minima of the smoothed energy that are `drop` times lower than what is around.

    Found on an even clock (a Gaussian of frames is one of seconds only there).
    """
    motion = even(time_s, energy[:, None, None].repeat(3, axis=2))
    values = np.clip(motion.xyz[:, 0, 0], 0, None)
    if np.isnan(values).any() or len(values) < 3:
        return []
    smooth = gaussian_filter1d(values, smoothing_s * motion.rate, mode="nearest")
    # So that noise about rest has no minima: a thousandth of what is usual counts as rest.
    level = np.log(smooth + 1e-3 * float(np.median(smooth)) + 1e-12)
    padded = np.concatenate([[level.max()], level, [level.max()]])
    peaks, _ = find_peaks(
        -padded, prominence=np.log(drop), distance=max(1, round(apart_s * motion.rate))
    )
    # The ends themselves are cuts, not rests.
    inner = [peak - 1 for peak in peaks if 1 < peak < len(level)]
    return [int(np.abs(time_s - motion.time_s[i]).argmin()) for i in inner]
