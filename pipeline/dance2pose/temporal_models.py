"""The temporal models themselves, each a function of one run of frames without gaps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import signal

from dance2pose.errors import UsageError

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sampling:
    """What a model may know beside the values: the settings, and the times of the frames.

    window: frames. step_s: median time between frames in seconds, 1 where times are unknown.
    cutoff_hz: cut-off asked for, None to derive it from the window. beta: see `smooth`.
    extent: (1-99 percentile) range of the widest coordinate, the yardstick of `beta`.
    """

    window: int
    step_s: float = 1.0
    cutoff_hz: float | None = None
    beta: float = 1.0
    extent: float = 1.0


# A kernel smooths one run without gaps: values (n, C) with n >= 1, times (n,) in seconds.
Kernel = Callable[[Float64Array, Float64Array, Sampling], Float64Array]


@dataclass(frozen=True)
class TemporalModel:
    """One entry of `MODELS`.

    lag: how many frames the output is late on motion of constant speed, as a function of the
    window (the group delay at frequency zero); for One-Euro the most it can be.
    """

    name: str
    title: str
    source: str
    causal: bool
    lag: Callable[[int], float]
    kernel: Kernel


# --- the paper's models as digital filters: y = b * x - a[1:] * y ---------------------------------


def _sma(window: int) -> tuple[Float64Array, Float64Array]:
    return np.full(window, 1.0 / window), np.ones(1)


def _wma(window: int) -> tuple[Float64Array, Float64Array]:
    weights = np.arange(window, 0, -1, dtype=np.float64)
    return weights / weights.sum(), np.ones(1)


def _exponential(alpha: float) -> tuple[Float64Array, Float64Array]:
    return np.array([alpha]), np.array([1.0, alpha - 1.0])


def _ema(window: int) -> tuple[Float64Array, Float64Array]:
    return _exponential(2.0 / (window + 1.0))


def _mma(window: int) -> tuple[Float64Array, Float64Array]:
    return _exponential(1.0 / window)


Coefficients = Callable[[int], tuple[Float64Array, Float64Array]]


def _moving(coefficients: Coefficients) -> Kernel:
    """Eq. 6 and 8: S_t itself for t <= w (counted from 1), the weighted mean from t = w + 1."""

    def kernel(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
        b, a = coefficients(sampling.window)
        out: Float64Array = signal.lfilter(b, a, values, axis=0)
        out[: sampling.window] = values[: sampling.window]
        return out

    return kernel


def _recursive(coefficients: Coefficients) -> Kernel:
    """Eq. 7 and 9: the first value itself, then (1 - alpha) previous + alpha S_t."""

    def kernel(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
        b, a = coefficients(sampling.window)
        state = -a[1] * values[:1] if len(a) > 1 else None
        out: Float64Array = signal.lfilter(b, a, values, axis=0, zi=state)[0]
        return out

    return kernel


def _zero_phase(coefficients: Coefficients) -> Kernel:
    """The same filter once forwards and once backwards: the lags cancel.

    The ends are continued point-symmetrically about the first and last value, so that motion of
    constant speed keeps its speed up to the ends.
    """

    def kernel(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
        b, a = coefficients(sampling.window)
        padding = min(len(values) - 1, 6 * sampling.window)
        out: Float64Array = signal.filtfilt(b, a, values, axis=0, padlen=padding)
        return out

    return kernel


# --- what practitioners use -----------------------------------------------------------------------


def _savitzky_golay(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
    """A parabola fitted to the window around each frame. Short runs get a shorter window."""
    longest = len(values) if len(values) % 2 else len(values) - 1
    window = min(sampling.window, longest)
    if window < 3:
        return values.copy()
    out: Float64Array = signal.savgol_filter(values, window, 2, axis=0, mode="interp")
    return out


# Two passes of an order-2 Butterworth filter attenuate by 3 dB at the cut-off times
# (2**(1/2) - 1)**(1/4) (Winter, Biomechanics and Motor Control of Human Movement).
_TWO_PASSES = (2**0.5 - 1) ** 0.25
# A mean over w frames attenuates by 3 dB at this number over sqrt(w^2 - 1), in cycles per frame.
_MEAN_CUTOFF = 0.442947


def _butterworth(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
    """Order 2, forwards and backwards; the whole attenuates by 3 dB at the cut-off."""
    if sampling.cutoff_hz is None:
        per_frame = _MEAN_CUTOFF / np.sqrt(sampling.window**2 - 1)
    else:
        per_frame = sampling.cutoff_hz * sampling.step_s
    corrected = per_frame / _TWO_PASSES
    if corrected >= 0.5:
        raise UsageError(
            f"a cut-off of {sampling.cutoff_hz:g} Hz is too high for"
            f" {1 / sampling.step_s:g} frames/s; the highest is {_highest_cutoff(sampling):.3g} Hz"
        )
    sections = signal.butter(2, 2 * corrected, output="sos")
    padding = min(len(values) - 1, int(np.ceil(2 / corrected)))
    out: Float64Array = signal.sosfiltfilt(sections, values, axis=0, padlen=padding)
    return out


def _highest_cutoff(sampling: Sampling) -> float:
    return 0.499 * _TWO_PASSES / sampling.step_s


def _one_euro(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
    """Casiez, Roussel, Vogel, CHI 2012: an EMA whose cut-off rises with the speed.

    At rest it is the EMA of the same window, unless a cut-off is given.
    """
    at_rest_s = sampling.step_s * (sampling.window - 1) / 2  # time constant
    lowest_hz = sampling.cutoff_hz or 1 / (2 * np.pi * at_rest_s)
    speed_time_s = 1 / (2 * np.pi)  # the paper's cut-off of 1 Hz for the speed
    rise = sampling.beta / sampling.extent
    out = np.empty_like(values)
    out[0] = values[0]
    speed = np.zeros(values.shape[1])
    for t in range(1, len(values)):
        step_s = times[t] - times[t - 1]
        if step_s <= 0:  # two frames of one time: no speed can be told from them
            step_s = sampling.step_s
        momentary = (values[t] - out[t - 1]) / step_s
        speed += (momentary - speed) * (step_s / (step_s + speed_time_s))
        cutoff_hz = lowest_hz + rise * np.abs(speed)
        alpha = step_s / (step_s + 1 / (2 * np.pi * cutoff_hz))
        out[t] = out[t - 1] + alpha * (values[t] - out[t - 1])
    return out


def _none(values: Float64Array, times: Float64Array, sampling: Sampling) -> Float64Array:
    return values.copy()


def _no_lag(window: int) -> float:
    return 0.0


def _half(window: int) -> float:
    return (window - 1) / 2


def _third(window: int) -> float:
    return (window - 1) / 3


def _whole(window: int) -> float:
    return window - 1.0


_PAPER = "Nguyen, Ngo, Le, A Spatial-Temporal 3D Human Pose Reconstruction Framework, eq. "
_TWICE = "the filter run forwards and backwards (scipy.signal.filtfilt)"

MODELS: dict[str, TemporalModel] = {
    model.name: model
    for model in (
        TemporalModel("none", "no smoothing", "", True, _no_lag, _none),
        TemporalModel("sma", "simple moving average", _PAPER + "6", True, _half, _moving(_sma)),
        TemporalModel(
            "ema", "exponential moving average", _PAPER + "7", True, _half, _recursive(_ema)
        ),
        TemporalModel("wma", "weighted moving average", _PAPER + "8", True, _third, _moving(_wma)),
        TemporalModel(
            "mma", "modified moving average", _PAPER + "9", True, _whole, _recursive(_mma)
        ),
        TemporalModel(
            "sma-zero-phase", "SMA without lag", _TWICE, False, _no_lag, _zero_phase(_sma)
        ),
        TemporalModel(
            "ema-zero-phase", "EMA without lag", _TWICE, False, _no_lag, _zero_phase(_ema)
        ),
        TemporalModel(
            "wma-zero-phase", "WMA without lag", _TWICE, False, _no_lag, _zero_phase(_wma)
        ),
        TemporalModel(
            "mma-zero-phase", "MMA without lag", _TWICE, False, _no_lag, _zero_phase(_mma)
        ),
        TemporalModel(
            "one-euro", "One-Euro filter", "Casiez et al., CHI 2012", True, _half, _one_euro
        ),
        TemporalModel(
            "savitzky-golay",
            "Savitzky-Golay, parabola",
            "Savitzky, Golay, Anal. Chem. 1964",
            False,
            _no_lag,
            _savitzky_golay,
        ),
        TemporalModel(
            "butterworth",
            "Butterworth low-pass of order 2, both ways",
            "Winter, Biomechanics and Motor Control of Human Movement",
            False,
            _no_lag,
            _butterworth,
        ),
    )
}
