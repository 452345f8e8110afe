"""A hole in time is a hole, whether rows are absent, frames are missing or timestamps jump."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.errors import UsageError
from dance2pose.holes import holes, usual_step
from dance2pose.smoothing import MODELS, smooth

T = 40


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        (np.arange(9) / 25, []),
        (np.delete(np.arange(9) / 25, 4), [3]),
        (np.delete(np.arange(30) / 25, range(10, 20)), [9]),
        (np.round(np.arange(60) / 60, 2), []),  # rounded to steps of 0.01 and 0.02
        (np.cumsum([1, 1, 2, 1, 2, 2, 1, 1, 2, 1, 30, 1, 2, 1, 1]), [9]),  # a variable rate
        (np.arange(0, 60, 5), []),
        ([0.0, 0.0, 0.0], []),
        ([3.0], []),
    ],
)
def test_steps_much_longer_than_usual_are_holes(times: np.ndarray, expected: list[int]) -> None:
    assert np.flatnonzero(holes(times)).tolist() == expected


def test_frames_tell_holes_where_they_are_known() -> None:
    frame = np.arange(100)
    shown = np.cumsum(np.where(frame % 33 == 5, 2, 1)) / 30  # a picture shown for twice as long
    assert holes(shown).sum() == 3
    assert holes(shown, frame).sum() == 0
    assert np.flatnonzero(holes(shown, frame + (frame > 50))).tolist() == [50]
    assert np.flatnonzero(holes(shown + (frame > 50), frame)).tolist() == [50]
    with pytest.raises(ValueError, match="neither"):
        holes(None)


@settings(deadline=None)
@given(st.lists(st.floats(0.001, 10), min_size=1, max_size=30))
def test_the_usual_step_is_one_that_occurs(steps: list[float]) -> None:
    step = usual_step(np.cumsum([0.0, *steps]))
    assert np.median(steps) <= step * (1 + 1e-9)
    assert step <= max(steps) * (1 + 1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_nothing_flows_across_a_hole_whether_its_rows_are_there_or_not(model: str) -> None:
    time_s = np.arange(T) / 25
    values = np.sin(np.arange(T * 3.0)).reshape(T, 3)
    values[20:] += 100
    away = (np.arange(T) >= 15) & (np.arange(T) < 25)
    listed = np.where(away[:, np.newaxis], np.nan, values)
    options = {"model": model, "window": 5}
    expected = smooth(listed, time_s=time_s, **options)[~away]
    absent = smooth(values[~away], time_s=time_s[~away], **options)
    by_frame = smooth(values[~away], time_s=time_s[~away], frame=np.flatnonzero(~away), **options)
    np.testing.assert_allclose(absent, expected, atol=1e-9)
    np.testing.assert_allclose(by_frame, expected, atol=1e-9)
    assert np.abs(absent[:15]).max() < 5 and np.abs(absent[15:] - 100).max() < 5


@settings(max_examples=60, deadline=None)
@given(
    gone=st.sets(st.integers(1, T - 2), max_size=4),
    model=st.sampled_from([name for name in MODELS if name != "one-euro"]),
)
def test_random_holes_are_the_same_as_missing_rows(gone: set[int], model: str) -> None:
    values = np.random.default_rng(7).normal(size=(T, 2))
    there = [t for t in range(T) if t not in gone]
    listed = values.copy()
    listed[list(gone)] = np.nan
    expected = smooth(listed, model=model, window=3)[there]
    np.testing.assert_allclose(
        smooth(values[there], model=model, window=3, frame=np.array(there)), expected
    )


def test_frame_numbers_must_fit_the_rows() -> None:
    with pytest.raises(UsageError, match=r"frame has shape \(3,\), expected \(5,\)"):
        smooth(np.zeros(5), window=1 + 1, frame=[1, 2, 3])
