"""The temporal models against the equations written out, and what must hold for all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dance2pose.errors import UsageError
from dance2pose.limits import model as limits
from dance2pose.poses import Timeline, Track3D
from dance2pose.smoothing import MODELS, check_window, smooth, smooth_track

T, J = 23, 5
NAMES = list(MODELS)
LINEAR = [name for name in NAMES if name != "one-euro"]
CAUSAL = [name for name in NAMES if MODELS[name].causal]


# The equations of the paper, letter by letter: S[1..N], one number a frame.


def _sma(S: dict[int, float], w: int) -> dict[int, float]:
    out = {}
    for t in S:
        if t <= w:
            out[t] = S[t]
        else:
            out[t] = sum(S[i] for i in range(t - w + 1, t + 1)) / w
    return out


def _ema(S: dict[int, float], w: int) -> dict[int, float]:
    alpha = 2 / (w + 1)
    out = {1: S[1]}
    for t in range(2, len(S) + 1):
        out[t] = (1 - alpha) * out[t - 1] + alpha * S[t]
    return out


def _wma(S: dict[int, float], w: int) -> dict[int, float]:
    out = {}
    for t in S:
        if t <= w:
            out[t] = S[t]
        else:
            out[t] = sum((w - k) * S[t - k] for k in range(w)) / sum(w - k for k in range(w))
    return out


def _mma(S: dict[int, float], w: int) -> dict[int, float]:
    out = {1: S[1]}
    for t in range(2, len(S) + 1):
        out[t] = (1 - 1 / w) * out[t - 1] + 1 / w * S[t]
    return out


Equation = Callable[[dict[int, float], int], dict[int, float]]
EQUATIONS: dict[str, Equation] = {"sma": _sma, "ema": _ema, "wma": _wma, "mma": _mma}


@pytest.mark.parametrize("name", EQUATIONS)
@pytest.mark.parametrize("window", [1, 2, 3, 4, 5, 11, T - 1, T])
def test_the_paper_s_models_are_its_equations(name: str, window: int) -> None:
    values = np.random.default_rng(window).normal(size=(T, J))
    smoothed = smooth(values, model=name, window=window)
    for j in range(J):
        sequence = {t: float(values[t - 1, j]) for t in range(1, T + 1)}
        expected = EQUATIONS[name](sequence, window)
        for t in range(1, T + 1):
            assert smoothed[t - 1, j] == pytest.approx(expected[t], abs=1e-12)


@pytest.mark.parametrize("name", EQUATIONS)
def test_behind_a_gap_the_equations_start_afresh(name: str) -> None:
    values = np.random.default_rng(7).normal(size=T)
    values[6:9] = np.nan
    smoothed = smooth(values, model=name, window=4)
    np.testing.assert_array_equal(smoothed[:6], smooth(values[:6], model=name, window=4))
    np.testing.assert_array_equal(smoothed[9:], smooth(values[9:], model=name, window=4))
    assert np.isnan(smoothed[6:9]).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_run_is_smoothed_as_if_it_were_alone(name: str) -> None:
    values = np.random.default_rng(8).normal(size=(2 * T, 2))
    values[T, 0] = np.nan
    options = {"model": name, "window": 5}
    if name == "one-euro":  # its yardstick is the extent of all that is given
        options["beta"] = 0.0
    smoothed = smooth(values, **options)
    np.testing.assert_allclose(smoothed[:T, 0], smooth(values[:T, 0], **options), atol=1e-12)
    np.testing.assert_allclose(smoothed[:, 1], smooth(values[:, 1], **options), atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("window", [3, 5, 9])
def test_the_lag_is_as_stated(name: str, window: int) -> None:
    length, middle = 600, 300
    ramp = np.arange(length, dtype=float)
    # Without the rise of its cut-off, One-Euro lags the most it can.
    smoothed = smooth(ramp, model=name, window=window, beta=0.0)
    assert ramp[middle] - smoothed[middle] == pytest.approx(MODELS[name].lag(window), abs=1e-3)


@pytest.mark.parametrize("name", [n for n in NAMES if not MODELS[n].causal])
def test_what_does_not_lag_follows_a_ramp_to_its_ends(name: str) -> None:
    ramp = np.outer(np.arange(80.0), (1.0, -3.0))
    np.testing.assert_allclose(smooth(ramp, model=name, window=5), ramp, atol=0.05)


@pytest.mark.parametrize("name", [n for n in NAMES if n != "none"])
def test_noise_is_reduced(name: str) -> None:
    noise = np.random.default_rng(3).normal(size=2000)
    for narrow, wide in ((3, 9), (9, 25)):
        rough = smooth(noise, model=name, window=narrow, beta=0.01)[100:-100].std()
        calm = smooth(noise, model=name, window=wide, beta=0.01)[100:-100].std()
        assert calm < 0.9 * rough < 0.9


@pytest.mark.parametrize("name", CAUSAL)
def test_causal_models_do_not_look_ahead(name: str) -> None:
    values = np.random.default_rng(4).normal(size=(T, J))
    changed = values.copy()
    changed[12:] += 5
    before = smooth(values, model=name, window=4, beta=0.0)
    after = smooth(changed, model=name, window=4, beta=0.0)
    np.testing.assert_array_equal(before[:12], after[:12])
    assert (before[12:] != after[12:]).any()


@pytest.mark.parametrize("name", [n for n in NAMES if not MODELS[n].causal])
def test_models_without_lag_treat_both_directions_of_time_alike(name: str) -> None:
    values = np.cumsum(np.random.default_rng(5).normal(size=(200, J)), axis=0)
    forwards = smooth(values, model=name, window=5)
    backwards = smooth(values[::-1], model=name, window=5)[::-1]
    np.testing.assert_allclose(forwards[50:-50], backwards[50:-50], atol=1e-6)


# Properties of all models.

sequences = arrays(
    np.float64,
    st.tuples(st.integers(5, 30), st.integers(1, 4), st.integers(1, 3)),
    elements=st.floats(-1e3, 1e3, width=32) | st.just(np.nan),
)
models = st.sampled_from(NAMES)
windows = st.sampled_from([1, 3, 5])


@given(sequences, models, windows)
@settings(deadline=None, max_examples=150)
def test_missing_stays_missing_and_nothing_else_does(
    values: np.ndarray, model: str, window: int
) -> None:
    before = values.copy()
    smoothed = smooth(values, model=model, window=window)
    assert smoothed.shape == values.shape
    np.testing.assert_array_equal(np.isnan(smoothed), np.isnan(values))
    np.testing.assert_array_equal(values, before)


# Subnormal numbers, down to 5e-324, have no relative precision.
@given(st.floats(-1e6, 1e6, allow_subnormal=False), st.integers(5, 30), models, windows)
@settings(deadline=None, max_examples=100)
def test_rest_is_preserved(value: float, length: int, model: str, window: int) -> None:
    values = np.full((length, 2), value)
    np.testing.assert_allclose(smooth(values, model=model, window=window), values, rtol=1e-9)


@given(sequences, st.floats(-5, 5), st.sampled_from(LINEAR), windows)
@settings(deadline=None, max_examples=100)
def test_linear_models_are_linear(
    values: np.ndarray, factor: float, model: str, window: int
) -> None:
    other = np.random.default_rng(0).normal(size=values.shape)
    options = {"model": model, "window": window}
    separate = factor * smooth(values, **options) + smooth(
        np.where(np.isnan(values), np.nan, other), **options
    )
    together = smooth(factor * values + other, **options)
    np.testing.assert_allclose(together, separate, atol=1e-6)


@given(sequences, models, windows)
@settings(deadline=None, max_examples=100)
def test_where_the_world_is_and_in_what_unit_does_not_matter(
    values: np.ndarray, model: str, window: int
) -> None:
    options = {"model": model, "window": window}
    moved = smooth(values * 1024 + 256, **options)
    np.testing.assert_allclose(moved, smooth(values, **options) * 1024 + 256, atol=1e-2, rtol=1e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(T,), (T, 3), (T, 17, 3), (T, 2, 17, 3), (T, 0), (T, 4, 0)])
def test_any_trailing_shape(name: str, shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(6).normal(size=shape)
    smoothed = smooth(values, model=name, window=5, beta=0.0)
    assert smoothed.shape == shape
    flat = values.reshape(T, -1) if values.size else np.empty((T, 0))
    for c in range(flat.shape[1]):
        alone = smooth(flat[:, c], model=name, window=5, beta=0.0)
        np.testing.assert_allclose(smoothed.reshape(T, -1)[:, c], alone, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_dtype_is_kept_and_the_sums_are_made_in_float64(name: str) -> None:
    values = np.full(T, 0.1, np.float32)
    smoothed = smooth(values, model=name, window=5)
    assert smoothed.dtype == np.float32
    np.testing.assert_allclose(smoothed, values, rtol=1e-7)
    assert smooth(np.arange(T), model=name, window=5).dtype == np.float64


def test_read_only_and_strided_input_is_fine() -> None:
    values = np.random.default_rng(9).normal(size=(2 * T, J))[::2]
    values.flags.writeable = False
    np.testing.assert_array_equal(smooth(values, window=3), smooth(values.copy(), window=3))


# Models that know seconds.


def test_one_euro_follows_fast_motion_more_closely_than_slow() -> None:
    time_s = np.arange(400) / 50
    values = np.where(time_s < 4, 0.01 * time_s, 0.04 + 3 * (time_s - 4))
    smoothed = smooth(values, model="one-euro", window=9, time_s=time_s, beta=10.0)
    speed = np.gradient(values, time_s)
    late_s = (values - smoothed) / speed
    assert late_s[380] < 0.5 * late_s[180]


def test_one_euro_uses_the_times_of_the_frames() -> None:
    times = np.cumsum(np.random.default_rng(2).choice([0.01, 0.02, 0.08], size=300))
    slow = np.sin(times)
    smoothed = smooth(slow, model="one-euro", window=5, time_s=times, cutoff_hz=1.0, beta=0.0)
    expected = [slow[0]]
    for t in range(1, len(slow)):
        step = times[t] - times[t - 1]
        alpha = 1 / (1 + 1 / (2 * np.pi * 1.0) / step)
        expected.append(alpha * slow[t] + (1 - alpha) * expected[-1])
    np.testing.assert_allclose(smoothed, expected, atol=1e-12)


def test_one_euro_bears_frames_of_one_time() -> None:
    times = np.repeat(np.arange(12) / 25, 2)
    values = np.arange(24.0)
    assert np.isfinite(smooth(values, model="one-euro", window=5, time_s=times)).all()


def test_butterworth_attenuates_by_3_db_at_its_cutoff() -> None:
    time_s = np.arange(2000) / 100
    for hertz, factor in ((0.5, 1.0), (6.0, 0.7071), (30.0, 0.0)):
        wave = np.sin(2 * np.pi * hertz * time_s)
        smoothed = smooth(wave, model="butterworth", window=5, time_s=time_s, cutoff_hz=6.0)
        middle = slice(500, 1500)
        assert smoothed[middle].std() / wave[middle].std() == pytest.approx(factor, abs=0.01)


def test_butterworth_and_the_mean_of_a_window_smooth_alike() -> None:
    noise = np.random.default_rng(1).normal(size=20000)
    for window in (5, 9, 15):
        mean = smooth(noise, model="sma", window=window)[100:-100].std()
        butterworth = smooth(noise, model="butterworth", window=window)[100:-100].std()
        assert butterworth == pytest.approx(mean, rel=0.15)


# Bad input.


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"window": 0}, "window of 0"),
        ({"window": -3}, "window of -3"),
        ({"window": 2.5}, "window 2.5: expected a whole number"),
        ({"window": True}, "window True: expected a whole number"),
        ({"window": T + 1}, f"window of {T + 1} frames is longer than the sequence of {T}"),
        ({"model": "sgolay"}, "unknown temporal model 'sgolay'; known: none, sma"),
        ({"model": "savitzky-golay", "window": 4}, "odd window, not 4; give 3 or 5"),
        ({"time_s": np.arange(T + 1.0)}, "time_s has shape"),
        ({"time_s": np.arange(T)[::-1] * 1.0}, "run backwards"),
        ({"time_s": np.full(T, np.nan)}, "must be finite"),
        ({"cutoff_hz": 6.0, "time_s": np.arange(T) / 50}, "not for mma"),
        ({"model": "butterworth", "cutoff_hz": 6.0}, "needs the times"),
        ({"model": "butterworth", "cutoff_hz": -6.0, "time_s": np.arange(T) / 50}, "positive"),
        ({"model": "butterworth", "cutoff_hz": 26.0, "time_s": np.arange(T) / 50}, "highest is 20"),
        ({"model": "one-euro", "beta": -1.0}, "beta"),
    ],
)
def test_a_wrong_setting_is_named(options: dict[str, object], complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        smooth(np.random.default_rng(0).normal(size=(T, J)), **options)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        (np.empty((0, 3)), "no frame"),
        (np.float64(3), "no frame"),
        (np.array(["a", "b"]), "cannot be smoothed"),
        (np.array([True, False]), "cannot be smoothed"),
        (np.array([1, 2, np.inf, 4, 5, 6]), "row 2 .* infinite"),
        (np.ones(1), "longer than the sequence of 1"),
    ],
)
def test_wrong_values_are_refused(values: np.ndarray, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        smooth(values, window=5)


def test_one_frame_with_a_window_of_one_is_kept() -> None:
    np.testing.assert_array_equal(smooth(np.array([[1.0, np.nan]]), window=1), [[1.0, np.nan]])


@pytest.mark.parametrize("name", NAMES)
def test_all_missing_stays_all_missing(name: str) -> None:
    assert np.isnan(smooth(np.full((T, 3), np.nan), model=name, window=5)).all()


def test_check_window_agrees_with_smooth() -> None:
    for name in NAMES:
        check_window(name, 5)
    with pytest.raises(UsageError):
        check_window("sma", 0)


# Tracks.


def _poses(length: int, *, root: bool) -> Track3D:
    rng = np.random.default_rng(length)
    xyz = rng.normal(size=(length, 15, 3))
    xyz[:, 0] = 0
    xyz[1, 4] = np.nan
    return Track3D(
        person=2,
        timeline=Timeline(np.arange(length, dtype=np.int64) * 3, np.arange(length) / 10),
        xyz=xyz,
        unit="body heights",
        skeleton="paper15",
        reprojection_error=rng.uniform(size=(length, 15)),
        valid=rng.uniform(size=(length, 14)) > 0.5,
        estimated=rng.uniform(size=(length, 15)) > 0.5,
        sigma=rng.uniform(size=(length, 15)),
        root=rng.normal(size=(length, 3)) if root else None,
    )


@pytest.mark.parametrize("root", [False, True])
def test_a_track_is_smoothed_and_the_rest_of_it_kept(root: bool) -> None:
    raw = _poses(11, root=root)
    smoothed = smooth_track(raw, model="ema", window=4)
    np.testing.assert_array_equal(smoothed.xyz, smooth(raw.xyz, model="ema", window=4))
    np.testing.assert_array_equal(smoothed.xyz[:, 0], 0)
    if root:
        assert raw.root is not None and smoothed.root is not None
        np.testing.assert_array_equal(smoothed.root, smooth(raw.root, model="ema", window=4))
    recomputed = ("xyz", "root", "valid", "reprojection_error", "sigma")
    for field in dataclasses.fields(Track3D):
        if field.name not in recomputed:
            assert getattr(smoothed, field.name) is getattr(raw, field.name)


def test_what_described_the_old_poses_does_not_describe_the_new_ones() -> None:
    raw = _poses(11, root=True)
    smoothed = smooth_track(raw, model="ema", window=4)
    np.testing.assert_array_equal(smoothed.valid, limits.load("paper15").is_valid(smoothed.xyz))
    assert np.isnan(smoothed.reprojection_error).all()
    assert smoothed.sigma is None
    assert smooth_track(raw, model="none") is raw


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("length", [2, 3, 4])
def test_a_track_shorter_than_the_window_goes_through(name: str, length: int) -> None:
    raw = _poses(length, root=True)
    smoothed = smooth_track(raw, model=name, window=5)
    np.testing.assert_array_equal(np.isnan(smoothed.xyz), np.isnan(raw.xyz))
    if name in ("sma", "wma"):
        np.testing.assert_array_equal(smoothed.xyz, raw.xyz)


def test_a_track_keeps_the_faults_of_its_settings() -> None:
    with pytest.raises(UsageError, match="window of 0"):
        smooth_track(_poses(9, root=False), window=0)
