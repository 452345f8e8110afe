"""Temporal models: smoothing of any sequence along its first axis.

SMA, EMA, WMA and MMA are the paper's equations 6-9 as they stand: causal, so that they lag behind
the motion. Beside them stand the same four without lag (zero phase) and what practitioners use:
One-Euro, Savitzky-Golay, Butterworth. `MODELS` lists them all with their lag.

Every coordinate is smoothed on its own. NaN is missing: a gap stays a gap of the same length, its
neighbours are not pulled towards anything, and the model starts afresh behind it; so it does where
rows are absent or time jumps (`holes`). Frames count, not seconds, except for One-Euro and where a
cut-off in hertz is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.errors import UsageError
from dance2pose.holes import holes
from dance2pose.limits import model as limits
from dance2pose.options import SmoothOptions, nearest
from dance2pose.poses import FloatArray, Track3D
from dance2pose.temporal_models import MODELS as MODELS
from dance2pose.temporal_models import Float64Array, Sampling
from dance2pose.temporal_models import TemporalModel as TemporalModel

DEFAULT_MODEL = "mma"
DEFAULT_WINDOW = SmoothOptions.window
DEFAULT_BETA = 5.0
_TOGETHER = 9  # columns filtered in one call; kernels hold several copies of them


def smooth(
    values: npt.ArrayLike,
    *,
    model: str = DEFAULT_MODEL,
    window: int = DEFAULT_WINDOW,
    time_s: npt.ArrayLike | None = None,
    frame: npt.ArrayLike | None = None,
    cutoff_hz: float | None = None,
    beta: float = DEFAULT_BETA,
) -> FloatArray:
    """Smooth a sequence along its first axis.

    values: (T, ...) numbers of any unit, NaN where missing; not changed. model: a name of
    `MODELS`. window: frames, from 1 (which changes nothing) to T. time_s: (T,) times of the
    frames in seconds, used by one-euro and where a cut-off is given. frame: (T,) their numbers;
    either tells holes in time, across which nothing flows (`holes.holes`). cutoff_hz: for
    butterworth and one-euro, instead of the one that follows from the window (a mean over the
    window has the same 3 dB point; One-Euro at rest is the EMA of the window). beta: for
    one-euro, by how many hertz the cut-off rises when a value crosses the extent of the data in
    one second (the extent makes it independent of the unit of `values`).

    Returns (T, ...) in the dtype of `values` (float64 if they are integers), NaN exactly where
    `values` is NaN; computed in float64. A run between two holes that is shorter than the window
    is treated as a sequence of its own: SMA and WMA keep its values.

    Raises UsageError for an unknown model, a window below 1 or longer than the sequence, an even
    window for savitzky-golay, a sequence without frames, infinite or non-numeric values, times
    that do not fit or run backwards, and a cut-off that is not positive, lacks times, or lies
    above what the frame rate allows.
    """
    array = _numbers(values)
    if window > len(array):
        raise UsageError(
            f"a window of {window} frames is longer than the sequence of {len(array)} frames;"
            f" give a window of at most {len(array)}"
        )
    return smooth_part(
        array,
        model=model,
        window=window,
        time_s=time_s,
        frame=frame,
        cutoff_hz=cutoff_hz,
        beta=beta,
    )


def smooth_track(
    track: Track3D, *, model: str = DEFAULT_MODEL, window: int = DEFAULT_WINDOW
) -> Track3D:
    """The track with smoothed joints (and smoothed root, where there is one).

    A track shorter than the window is no error here (a shot of a film can be that short): the
    equations are applied as they stand. What described the poses before does not describe the
    new ones: bones are checked again against the joint-angle limits (`valid`), and the
    reprojection error and sigma, which cannot be known again, are dropped (NaN and None). Each
    coordinate is smoothed on its own, so bone lengths change a little: a mean of directions is
    shorter than each of them. The model "none" changes nothing.

    Raises UsageError as `smooth` does.
    """
    check_window(model, window)
    if len(track) == 0 or model == "none":
        return track
    part = partial(smooth_part, model=model, window=window, time_s=track.time_s, frame=track.frame)
    xyz, root = part(track.xyz), track.root
    if root is not None:
        root = part(root)
    lifted = skeletons.get(track.skeleton).is_tree  # only these have limits
    return replace(
        track,
        xyz=xyz,
        root=root,
        valid=limits.load(track.skeleton).is_valid(xyz) if lifted else track.valid,
        reprojection_error=np.full_like(track.reprojection_error, np.nan),
        sigma=None,
    )


def find_model(name: str) -> TemporalModel:
    """The model of that name; UsageError lists the known ones."""
    try:
        return MODELS[name]
    except KeyError:
        known = ", ".join(MODELS)
        raise UsageError(
            f"unknown temporal model {name!r}; known: {known}{nearest(name, MODELS)}"
        ) from None


def check_window(model: str, window: int) -> None:
    """Raise UsageError unless `model` is known and can work with `window`."""
    find_model(model)
    if not isinstance(window, int | np.integer) or isinstance(window, bool):
        raise UsageError(f"window {window!r}: expected a whole number of frames")
    if window < 1:
        raise UsageError(f"a window of {window} frames is not possible; give 1 or more")
    if model == "savitzky-golay" and window % 2 == 0:
        raise UsageError(
            f"savitzky-golay needs an odd window, not {window}; give {window - 1} or {window + 1}"
        )


def smooth_part(
    values: npt.ArrayLike,
    *,
    model: str,
    window: int,
    time_s: npt.ArrayLike | None = None,
    frame: npt.ArrayLike | None = None,
    cutoff_hz: float | None = None,
    beta: float = DEFAULT_BETA,
) -> FloatArray:
    """As `smooth`, for a sequence that may be shorter than the window: one shot, one person."""
    array = _numbers(values)
    check_window(model, window)
    times, step_s = _times(time_s, len(array))
    _check_cutoff(cutoff_hz, beta, model, timed=time_s is not None)
    if window == 1 and cutoff_hz is None:
        return array.copy()
    columns = array.reshape(len(array), -1).astype(np.float64, copy=False)
    extent = _extent(columns) if model == "one-euro" else 1.0  # no other model asks for it
    sampling = Sampling(window, step_s, cutoff_hz, beta, extent)
    kernel = MODELS[model].kernel
    out = np.full_like(columns, np.nan)
    for first, last in _stretches(time_s, frame, len(array)):
        for start, stop, members in _runs(np.isfinite(columns[first:last])):
            rows = slice(first + start, first + stop)
            for some in np.array_split(members, -(-len(members) // _TOGETHER)):
                out[rows, some] = kernel(columns[rows, some], times[rows], sampling)
    return out.reshape(array.shape).astype(array.dtype, copy=False)


def _stretches(
    time_s: npt.ArrayLike | None, frame: npt.ArrayLike | None, length: int
) -> list[tuple[int, int]]:
    """First row and row behind the last of every stretch without a hole in time."""
    cuts: list[int] = []
    if frame is not None and np.shape(frame) != (length,):
        raise UsageError(f"frame has shape {np.shape(frame)}, expected ({length},), one a row")
    if time_s is not None or frame is not None:
        cuts = (np.flatnonzero(holes(time_s, frame)) + 1).tolist()
    return list(pairwise([0, *cuts, length]))


def _runs(present: npt.NDArray[np.bool_]) -> Iterator[tuple[int, int, npt.NDArray[np.int64]]]:
    """The runs without gaps of a (T, C) mask: start, stop, and all columns that have this run.

    Columns with the same gaps (the coordinates of a joint, often all joints) are filtered in one
    call.
    """
    padded = np.zeros((len(present) + 2, present.shape[1]), np.int8)
    padded[1:-1] = present
    change = np.diff(padded, axis=0).T
    column, start = np.nonzero(change == 1)
    _, stop = np.nonzero(change == -1)
    order = np.lexsort((column, stop, start))
    column, start, stop = column[order], start[order], stop[order]
    new = np.flatnonzero((np.diff(start) != 0) | (np.diff(stop) != 0)) + 1
    for first, last in zip([0, *new], [*new, len(start)], strict=True):
        if first < last:
            yield int(start[first]), int(stop[first]), column[first:last]


def _extent(columns: Float64Array) -> float:
    """Range of the widest column between its 1st and 99th percentile; 1 where nothing moves."""
    seen = columns[:, np.isfinite(columns).any(axis=0)]
    if not seen.size:
        return 1.0
    low, high = np.nanpercentile(seen, (1, 99), axis=0)
    return float((high - low).max()) or 1.0


def _numbers(values: npt.ArrayLike) -> FloatArray:
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise UsageError(f"values of type {array.dtype} cannot be smoothed; expected numbers")
    if array.ndim == 0 or len(array) == 0:
        raise UsageError(f"values of shape {array.shape} hold no frame; nothing to smooth")
    if array.dtype.kind != "f":
        array = array.astype(np.float64)
    if np.isinf(array).any():
        frame = int(np.argwhere(np.isinf(array))[0][0])
        raise UsageError(f"the value in row {frame} (from 0) is infinite; missing values are NaN")
    return array


def _times(time_s: npt.ArrayLike | None, length: int) -> tuple[Float64Array, float]:
    """Times of the frames and the median step between them; frame numbers where not given."""
    if time_s is None:
        return np.arange(length, dtype=np.float64), 1.0
    times = np.asarray(time_s, dtype=np.float64)
    if times.shape != (length,):
        raise UsageError(f"time_s has shape {times.shape}, expected ({length},), one a frame")
    steps = np.diff(times)
    if not np.isfinite(times).all() or (steps < 0).any():
        raise UsageError("time_s must be finite and must not run backwards")
    step_s = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    return times, step_s


def _check_cutoff(cutoff_hz: float | None, beta: float, model: str, *, timed: bool) -> None:
    if not (np.isfinite(beta) and beta >= 0):
        raise UsageError(f"beta is {beta}, expected a number that is not negative")
    if cutoff_hz is None:
        return
    if model not in ("butterworth", "one-euro"):
        raise UsageError(f"a cut-off frequency is for butterworth and one-euro, not for {model}")
    if not (np.isfinite(cutoff_hz) and cutoff_hz > 0):
        raise UsageError(f"a cut-off of {cutoff_hz} Hz is not possible; give a positive number")
    if not timed:
        raise UsageError("a cut-off in hertz needs the times of the frames (time_s)")
