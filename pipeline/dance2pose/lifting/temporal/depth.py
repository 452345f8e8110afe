"""The depth network run over a whole track: every frame answered from about a second around it.

The network is trained on RATE_HZ frames a second. A track of f frames a second is taken apart into
round(f / RATE_HZ) interleaved series, each about that rate, and every series is answered in full;
so any rate gives one answer a frame, without interpolation and without lag.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from dance2pose.assets import asset
from dance2pose.lifting import error_calibration
from dance2pose.lifting.error_calibration import Calibration
from dance2pose.lifting.temporal.network import (
    BONE_OUTPUTS,
    BONES,
    FEATURES,
    RATE_HZ,
    longest_projections,
    mirrored,
    network_input,
    network_output,
)
from dance2pose.onnx_models.inference import Session, default_threads, open_session
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

_MODEL = "lifter.onnx"
_MIRROR = np.array(get("cmu17").mirror)
# Frames of one series answered at a time, and how many of its neighbours an answer depends on.
_CHUNK, _REACH = 512, 24
# Frames of short clips that are answered together: more do not stay in a core's cache.
_TOGETHER = 128
_UNEVEN = 0.3  # of the step between frames: how far a frame may lie from its even place
_SHORTEST_STEP_S = 1 / 120


@dataclass(frozen=True)
class Depth:
    """xyz: (T, J, 3) mm relative to `centre`, x right, y up, z towards the viewer. sigma_z and
    sigma: (T, J) mm, the network's own scale of the error of z and of the position. bones and
    sigma_bones: (T, J - 1), logarithm of the length that the network takes each bone to have beside
    the one body's, and the scale of its error; NaN of a network that does not say. Input =
    centre (T, 2) + scale (T,) * xyz."""

    xyz: FloatArray
    sigma_z: FloatArray
    sigma: FloatArray
    bones: FloatArray
    sigma_bones: FloatArray
    centre: FloatArray
    scale: FloatArray


@dataclass(frozen=True)
class Known:
    """What is known of the dancer and the keypoints before the network is asked.

    longest: (J - 1,) or (T, J - 1) in the unit of the input, the longest projections of the whole
    track; or, with `lengths`, the dancer's bone lengths. scale: (T,) input units a mm, for single
    pictures of figures whose size is known. error_mm: standard deviation of the keypoints' slow
    errors in each direction, at the dancer's size. None: not known.
    """

    longest: FloatArray | None = None
    lengths: bool = False
    scale: FloatArray | None = None
    error_mm: float | None = None


_NOTHING = Known()


def predict(
    xy: FloatArray,
    confidence: FloatArray,
    rate_hz: float,
    *,
    body17: bool,
    known: Known = _NOTHING,
) -> Depth:
    """Depths of T frames at an even rate.

    xy: (T, J, 2) y up, NaN where missing. confidence: (T, J) in 0..1.
    """
    if known.longest is None:
        known = replace(known, longest=longest_projections(xy[None])[0])
    stride = max(1, round(rate_hz / RATE_HZ))
    parts = []
    for rows in _slices(len(xy), _CHUNK * stride):
        low = max(0, rows.start - _REACH * stride)
        high = min(len(xy), rows.stop + _REACH * stride)
        part = _interleaved(xy[low:high], confidence[low:high], stride, body17, known)
        parts.append(_taken(part, slice(rows.start - low, rows.stop - low)))
    return joined(parts)


def predict_frames(
    xy: FloatArray, confidence: FloatArray, *, body17: bool, known: Known = _NOTHING
) -> Depth:
    """Depths of T frames that have nothing to do with each other; each has what is known of it.

    By default a bone's longest projection is what the frame shows of it.
    """
    parts = [
        _answer(xy[rows, None], confidence[rows, None], body17, _rows_of(known, rows))
        for rows in _slices(len(xy), _CHUNK)
    ]
    return joined([_each(lambda values: values[:, 0], part) for part in parts])


def _taken(part: Depth, rows: slice) -> Depth:
    return _each(lambda values: values[rows], part)


def _rows_of(known: Known, rows: slice) -> Known:
    longest = known.longest
    return replace(
        known,
        longest=longest if longest is None or longest.ndim == 1 else longest[rows],
        scale=None if known.scale is None else known.scale[rows],
    )


def predict_at(
    xy: FloatArray,
    confidence: FloatArray,
    time_s: FloatArray,
    *,
    body17: bool,
    known: Known,
) -> Depth:
    """As `predict`, for frames at any times (T,) s, strictly increasing.

    Frames that are not evenly spaced are resampled linearly at their median rate, at least
    RATE_HZ; the answers are read off that series at the frames' own times.
    """
    steps = np.diff(time_s)
    if not len(steps):
        return predict(xy, confidence, RATE_HZ, body17=body17, known=known)
    step = float(np.median(steps))
    even = time_s[0] + np.arange(len(time_s)) * (time_s[-1] - time_s[0]) / len(steps)
    if np.abs(even - time_s).max() < _UNEVEN * step and step < 1.5 / RATE_HZ:
        return predict(xy, confidence, 1 / step, body17=body17, known=known)
    step = min(max(step, _SHORTEST_STEP_S), 1 / RATE_HZ)
    grid = np.linspace(time_s[0], time_s[-1], 1 + round((time_s[-1] - time_s[0]) / step))
    given = predict(
        _read_off(xy, time_s, grid),
        _read_off(confidence, time_s, grid),
        1 / step,
        body17=body17,
        known=known,
    )
    return _each(lambda values: _read_off(values, grid, time_s), given)


def _read_off(values: FloatArray, time_s: FloatArray, at: FloatArray) -> FloatArray:
    """Values (T, ...) at other times, linearly; NaN where a neighbour that counts is NaN."""
    after = np.clip(np.searchsorted(time_s, at), 1, len(time_s) - 1)
    share = np.clip((at - time_s[after - 1]) / (time_s[after] - time_s[after - 1]), 0, 1)
    share = np.where(share < 1e-6, 0, np.where(share > 1 - 1e-6, 1, share))
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    start, end = values[after - 1], values[after]
    mixed = (1 - share) * start + share * end
    return np.asarray(np.where(share == 0, start, np.where(share == 1, end, mixed)))


def _slices(length: int, size: int) -> list[slice]:
    return [slice(start, min(start + size, length)) for start in range(0, length, size)]


def _interleaved(
    xy: FloatArray, confidence: FloatArray, stride: int, body17: bool, known: Known
) -> Depth:
    frames = len(xy)
    rows = np.minimum(np.arange(-(-frames // stride) * stride), frames - 1)
    rows = rows.reshape(-1, stride).T  # series, time
    answer = _answer(xy[rows], confidence[rows], body17, known)
    back = np.arange(frames)
    return _each(lambda values: values[back % stride, back // stride], answer)


def _answer(xy: FloatArray, confidence: FloatArray, body17: bool, known: Known) -> Depth:
    """Answers (B, T, ...) for clips (B, T, J, 2): the mean of the clip's and of its mirror's."""
    clips, frames = xy.shape[:2]
    longest = known.longest
    given = network_input(
        xy,
        confidence,
        body_definition=np.full(clips, body17),
        longest=None if longest is None else np.broadcast_to(longest, (clips, BONES)),
        known=np.full(clips, known.lengths),
        scale=known.scale,
        error_mm=None if known.error_mm is None else np.full(clips, known.error_mm),
    )
    mirror = mirrored(given)
    joints, bones = _run(np.concatenate([given.features, mirror.features]))
    xyz, sigma_z, sigma = network_output(joints[:clips], given)
    other_xyz, other_z, other_sigma = network_output(joints[clips:], mirror)
    length, error = bones[..., 0], np.exp(bones[..., 1])
    order = _MIRROR[1:] - 1
    return Depth(
        xyz=(xyz + other_xyz[:, :, _MIRROR] * [-1.0, 1.0, 1.0]) / 2,
        sigma_z=np.sqrt(sigma_z * other_z[:, :, _MIRROR]),
        sigma=np.sqrt(sigma * other_sigma[:, :, _MIRROR]),
        bones=(length[:clips] + length[clips:, :, order]) / 2,
        sigma_bones=np.sqrt(error[:clips] * error[clips:, :, order]),
        centre=given.centre,
        scale=np.broadcast_to(given.scale[:, None], (clips, frames)),
    )


def _run(features: npt.NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
    """What the network answers to clips (B, T, F), some of them at a time on each core."""
    session = _session()
    # Networks of before bodies differed look at fewer features and say nothing of bones.
    features = features[..., : session.inputs[0].shape[-1]]
    names = [output.name for output in session.outputs]
    together = max(1, _TOGETHER // features.shape[1])

    def answers(clips: slice) -> list[npt.NDArray[np.float32]]:
        return session.run({"features": features[clips]}, names)

    with ThreadPoolExecutor(default_threads(), thread_name_prefix="lifter") as cores:
        parts = list(cores.map(answers, _slices(len(features), together)))
    found = [np.concatenate(part, dtype=np.float64) for part in zip(*parts, strict=True)]
    if len(found) == 1:
        found.append(np.full((*features.shape[:2], BONES, BONE_OUTPUTS), np.nan))
    return found[0], found[1]


def give_back_memory() -> None:
    """Let go of what the network's runs took, 60 MB and more that ONNX Runtime would keep for the
    next ones: by a run of a single frame, for it does so only after one."""
    session = _session()
    features = np.zeros((1, 1, FEATURES), np.float32)[..., : session.inputs[0].shape[-1]]
    names = [output.name for output in session.outputs]
    session.run({"features": features}, names, may_hold_nan=True, give_back=True)


@lru_cache(maxsize=1)
def _session() -> Session:
    # One thread: cores that each answer clips of their own are busier than those that share one.
    return open_session(asset(_MODEL), threads=1)


def calibration(*, pictures: bool) -> Calibration:
    """How the lifter's errors were measured to follow from what it knows of them."""
    return error_calibration.read(_session().metadata, pictures=pictures)


def trained_takes() -> frozenset[str]:
    """The takes that the network was trained on, as its file names them; none where it does not."""
    return frozenset(_session().metadata.get("training_takes", "").split())


def joined(parts: list[Depth]) -> Depth:
    """One after the other in time."""
    return _each(lambda *values: np.concatenate(values), *parts)


def _each(change: Callable[..., FloatArray], *parts: Depth) -> Depth:
    """Every array of the parts changed, those of one name together."""
    names = [field.name for field in fields(Depth)]
    return Depth(**{n: change(*(getattr(part, n) for part in parts)) for n in names})
