"""Short gaps are filled in time, long ones and the ends are not."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.tracking.gaps import fill_gaps

T, J = 11, 4


def _line(time_s: np.ndarray) -> np.ndarray:
    """Keypoints that move at constant speed, each its own."""
    speed = np.random.default_rng(0).normal(size=(J, 2)) * 100
    return time_s[:, None, None] * speed + 200


def test_a_short_gap_is_filled_linearly_in_time_not_in_frames() -> None:
    time_s = np.array([0, 0.04, 0.08, 0.20, 0.22, 0.28, 0.32, 0.36, 0.4, 0.44, 0.48])
    expected = _line(time_s)
    xy = expected.copy()
    xy[2:5, 1] = np.nan
    filled_xy, filled = fill_gaps(xy, time_s, longest_s=0.25)
    np.testing.assert_allclose(filled_xy, expected)
    assert filled.sum() == 3 and filled[2:5, 1].all()


@pytest.mark.parametrize(("longest_s", "fills"), [(0.2, False), (0.24, True), (0.3, True)])
def test_the_limit_is_the_time_between_the_sights(longest_s: float, fills: bool) -> None:
    time_s = np.arange(T) * 0.06
    xy = _line(time_s)
    xy[3:6] = np.nan  # sights at rows 2 and 6: 0.24 s
    _, filled = fill_gaps(xy, time_s, longest_s=longest_s)
    assert filled.any() == fills


def test_the_ends_are_not_guessed() -> None:
    time_s = np.arange(T) * 0.01
    xy = _line(time_s)
    xy[:3, 0] = np.nan
    xy[-2:, 2] = np.nan
    xy[:, 3] = np.nan
    filled_xy, filled = fill_gaps(xy, time_s, longest_s=10)
    assert not filled.any()
    np.testing.assert_array_equal(filled_xy, xy)


def test_half_a_keypoint_is_a_missing_one() -> None:
    time_s = np.arange(T) * 0.01
    xy = _line(time_s)
    expected = xy.copy()
    xy[4, 1, 0] = np.nan
    filled_xy, filled = fill_gaps(xy, time_s, longest_s=1)
    np.testing.assert_allclose(filled_xy, expected)
    assert filled[4, 1]


def test_frames_of_one_time_are_borne() -> None:
    time_s = np.zeros(T)
    xy = _line(np.arange(T) * 0.01)
    xy[4:6] = np.nan
    filled_xy, _ = fill_gaps(xy, time_s, longest_s=1)
    assert np.isfinite(filled_xy).all()


def _slowly(xy: np.ndarray, time_s: np.ndarray, longest_s: float) -> np.ndarray:
    out = xy.copy()
    for j in range(xy.shape[1]):
        seen = [t for t in range(len(xy)) if np.isfinite(xy[t, j]).all()]
        for before, after in pairwise(seen):
            if time_s[after] - time_s[before] > longest_s + 1e-6:
                continue
            for t in range(before + 1, after):
                for axis in range(2):
                    out[t, j, axis] = np.interp(
                        time_s[t],
                        [time_s[before], time_s[after]],
                        [xy[before, j, axis], xy[after, j, axis]],
                    )
    return out


@given(st.integers(1, 25), st.floats(0, 0.9), st.floats(0.0, 0.6), st.integers(0, 2**16))
@settings(deadline=None, max_examples=80)
def test_as_a_slow_and_plain_reference_does_it(
    length: int, share_missing: float, longest_s: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.01, 0.2, length))
    xy = rng.normal(size=(length, 3, 2))
    xy[rng.uniform(size=(length, 3)) < share_missing] = np.nan
    before = xy.copy()
    filled_xy, filled = fill_gaps(xy, time_s, longest_s=longest_s)
    np.testing.assert_allclose(filled_xy, _slowly(xy, time_s, longest_s), atol=1e-9)
    np.testing.assert_array_equal(filled, np.isnan(xy).any(2) & np.isfinite(filled_xy).all(2))
    np.testing.assert_array_equal(xy, before)
