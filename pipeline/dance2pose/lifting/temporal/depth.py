"""The depth network run over a whole track: every frame answered from about a second around it.

The network is trained on RATE_HZ frames a second. A track of f frames a second is taken apart into
round(f / RATE_HZ) interleaved series, each about that rate, and every series is answered in full;
so any rate gives one answer a frame, without interpolation and without lag.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from dance2pose.assets import asset
from dance2pose.lifting.temporal.network import (
    JOINTS,
    RATE_HZ,
    NetworkInput,
    longest_projections,
    network_input,
    network_output,
)
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

_MODEL = "lifter.onnx"
_MIRROR = np.array(get("cmu17").mirror)
# Frames of one series answered at a time, and how many of its neighbours an answer depends on.
_CHUNK, _REACH = 2048, 24
_UNEVEN = 0.3  # of the step between frames: how far a frame may lie from its even place
_SHORTEST_STEP_S = 1 / 120


@dataclass(frozen=True)
class Depth:
    """xyz: (T, J, 3) mm relative to `centre`, x right, y up, z towards the viewer. sigma_z and
    sigma: (T, J) mm, the network's own scale of the error of z and of the position. Input =
    centre (T, 2) + scale (T,) * xyz."""

    xyz: FloatArray
    sigma_z: FloatArray
    sigma: FloatArray
    centre: FloatArray
    scale: FloatArray


def predict(
    xy: FloatArray,
    confidence: FloatArray,
    rate_hz: float,
    *,
    body17: bool,
    longest: FloatArray | None = None,
) -> Depth:
    """Depths of T frames at an even rate.

    xy: (T, J, 2) y up, NaN where missing. confidence: (T, J) in 0..1. longest: (J - 1,) of the
    whole track that the frames are part of.
    """
    if longest is None:
        longest = longest_projections(xy[None])[0]
    stride = max(1, round(rate_hz / RATE_HZ))
    parts = []
    for rows in _slices(len(xy), _CHUNK * stride):
        low = max(0, rows.start - _REACH * stride)
        high = min(len(xy), rows.stop + _REACH * stride)
        part = _interleaved(xy[low:high], confidence[low:high], stride, body17, longest)
        parts.append(_taken(part, slice(rows.start - low, rows.stop - low)))
    return joined(parts)


def predict_frames(
    xy: FloatArray, confidence: FloatArray, *, body17: bool, longest: FloatArray | None = None
) -> Depth:
    """Depths of T frames that have nothing to do with each other.

    As `predict`, but longest: (T, J - 1), the length of every bone in each frame, in its unit; by
    default what the frame shows of it.
    """
    parts = [
        _answer(
            xy[rows, None],
            confidence[rows, None],
            body17,
            None if longest is None else longest[rows],
        )
        for rows in _slices(len(xy), _CHUNK)
    ]
    return joined([_squeezed(part) for part in parts])


def predict_at(
    xy: FloatArray,
    confidence: FloatArray,
    time_s: FloatArray,
    *,
    body17: bool,
    longest: FloatArray,
) -> Depth:
    """As `predict`, for frames at any times (T,) s, strictly increasing.

    Frames that are not evenly spaced are resampled linearly at their median rate, at least
    RATE_HZ; the answers are read off that series at the frames' own times.
    """
    steps = np.diff(time_s)
    if not len(steps):
        return predict(xy, confidence, RATE_HZ, body17=body17, longest=longest)
    step = float(np.median(steps))
    even = time_s[0] + np.arange(len(time_s)) * (time_s[-1] - time_s[0]) / len(steps)
    if np.abs(even - time_s).max() < _UNEVEN * step and step < 1.5 / RATE_HZ:
        return predict(xy, confidence, 1 / step, body17=body17, longest=longest)
    step = min(max(step, _SHORTEST_STEP_S), 1 / RATE_HZ)
    grid = np.linspace(time_s[0], time_s[-1], 1 + round((time_s[-1] - time_s[0]) / step))
    given = predict(
        _read_off(xy, time_s, grid),
        _read_off(confidence, time_s, grid),
        1 / step,
        body17=body17,
        longest=longest,
    )
    return Depth(
        _read_off(given.xyz, grid, time_s),
        _read_off(given.sigma_z, grid, time_s),
        _read_off(given.sigma, grid, time_s),
        _read_off(given.centre, grid, time_s),
        _read_off(given.scale, grid, time_s),
    )


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
    xy: FloatArray, confidence: FloatArray, stride: int, body17: bool, longest: FloatArray
) -> Depth:
    frames = len(xy)
    rows = np.minimum(np.arange(-(-frames // stride) * stride), frames - 1)
    rows = rows.reshape(-1, stride).T  # series, time
    answer = _answer(xy[rows], confidence[rows], body17, longest)
    back = np.arange(frames)
    series, time = back % stride, back // stride
    return Depth(
        answer.xyz[series, time],
        answer.sigma_z[series, time],
        answer.sigma[series, time],
        answer.centre[series, time],
        answer.scale[series, time],
    )


def _answer(
    xy: FloatArray, confidence: FloatArray, body17: bool, longest: FloatArray | None
) -> Depth:
    """Answers (B, T, ...) for clips (B, T, J, 2): the mean of the clip's and of its mirror's.

    longest: (J - 1,) or (B, J - 1).
    """
    sides = []
    for mirrored in (False, True):
        order = _MIRROR if mirrored else np.arange(JOINTS)
        sign = np.array([-1.0 if mirrored else 1.0, 1.0])
        known = None
        if longest is not None:
            known = np.broadcast_to(longest[..., order[1:] - 1], (len(xy), JOINTS - 1))
        given = network_input(
            xy[:, :, order] * sign,
            confidence[:, :, order],
            body_definition=np.full(len(xy), body17),
            longest=known,
        )
        raw = _run(given)
        xyz, sigma_z, sigma = network_output(raw, given)
        sides.append((xyz[:, :, order] * [*sign, 1.0], sigma_z[:, :, order], sigma[:, :, order]))
    centre = given.centre * [-1.0, 1.0]
    scale = np.broadcast_to(given.scale[:, None], xy.shape[:2])
    (a, az, ap), (b, bz, bp) = sides
    return Depth((a + b) / 2, np.sqrt(az * bz), np.sqrt(ap * bp), centre, scale)


def _run(given: NetworkInput) -> npt.NDArray[np.float64]:
    session = _session()
    return np.asarray(session.run({"features": given.features}, ["joints"])[0], dtype=np.float64)


@lru_cache(maxsize=1)
def _session():  # type: ignore[no-untyped-def]
    from dance2pose.onnx_models.inference import (
        open_session,  # the numerical core loads without ONNX Runtime
    )

    return open_session(asset(_MODEL))


def sigma_factors() -> FloatArray:
    """(J,) what the network's scales are multiplied by, calibrated on held-out takes."""
    return np.array(
        json.loads(_session().metadata.get("sigma_factors", json.dumps([1.0] * JOINTS)))
    )


def trained_takes() -> frozenset[str]:
    """The takes that the network was trained on, as its file names them; none where it does not."""
    return frozenset(_session().metadata.get("training_takes", "").split())


def _squeezed(part: Depth) -> Depth:
    return Depth(
        part.xyz[:, 0], part.sigma_z[:, 0], part.sigma[:, 0], part.centre[:, 0], part.scale[:, 0]
    )


def _taken(part: Depth, rows: slice) -> Depth:
    return Depth(
        part.xyz[rows], part.sigma_z[rows], part.sigma[rows], part.centre[rows], part.scale[rows]
    )


def joined(parts: list[Depth]) -> Depth:
    """One after the other in time."""
    return Depth(
        np.concatenate([p.xyz for p in parts]),
        np.concatenate([p.sigma_z for p in parts]),
        np.concatenate([p.sigma for p in parts]),
        np.concatenate([p.centre for p in parts]),
        np.concatenate([p.scale for p in parts]),
    )
