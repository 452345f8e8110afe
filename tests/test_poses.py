"""The data between the stages: what it refuses, what is equal, how it reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dance2pose.errors import DataError
from dance2pose.poses import Dancer, Timeline, Track2D
from recording_making import make_dancer

T, J = 7, 17


def track(**changes: object) -> Track2D:
    xy = np.random.default_rng(3).uniform(0, 480, (T, J, 2))
    xy[2, 5] = np.nan
    usual = {"skeleton": "coco17", "time_s": np.arange(T) / 25, "image_size": (640, 480)}
    return Track2D.from_arrays(xy, **(usual | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("frame", "time_s", "said"),
    [
        ([0, 1, 1], [0.0, 0.1, 0.2], "frame must strictly increase; row 2 is 1 after 1"),
        ([0, 1, 2], [0.0, 0.1, 0.1], "time_s must strictly increase; row 2 is 0.1 after 0.1"),
        ([0, 1, 2], [0.0, 0.2, 0.1], "row 2 is 0.1"),
        ([0, 1, 2], [0.0, np.nan, 0.1], "row 1 is nan"),
        ([0, 1, 2], [0.0, 0.1, np.inf], "row 2 is inf"),
    ],
)
def test_a_timeline_strictly_increases(frame: list[int], time_s: list[float], said: str) -> None:
    with pytest.raises(DataError, match=said):
        Timeline(np.array(frame, np.int64), np.array(time_s))


@given(st.integers(0, 50), st.floats(1, 240), st.floats(-10, 10))
def test_a_regular_timeline_is_one(length: int, rate_hz: float, start_s: float) -> None:
    made = Timeline.regular(length, rate_hz=rate_hz, start_s=start_s)
    assert len(made) == length
    np.testing.assert_allclose(np.diff(made.time_s), 1 / rate_hz, atol=1e-9)


def test_a_track_from_arrays_marks_what_is_missing() -> None:
    made = track()
    assert made.confidence[2, 5] == 0
    assert (made.confidence.sum(), np.isnan(made.xy).sum()) == (T * J - 1, 2)
    assert np.isnan(made.box).all() and not made.interpolated.any()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time_s": np.arange(T + 1)}, r"time_s has shape \(8,\), expected \(7,\)"),
        ({"confidence": np.ones((T, J + 1))}, r"confidence has shape \(7, 18\)"),
        ({"frame": np.zeros(T)}, "frame must strictly increase"),
    ],
)
def test_arrays_that_do_not_fit_are_named(changes: dict[str, object], said: str) -> None:
    with pytest.raises(DataError, match=said):
        track(**changes)


def test_equal_means_all_fields_with_missing_equal_to_missing() -> None:
    assert track() == track()
    assert track() != track(person=2)
    assert track() != track(time_s=np.arange(T) / 24)
    assert track() != "a track"
    other = track()
    other.xy[0, 0, 0] += 1
    assert track() != other


def test_the_text_of_each_says_what_it_holds() -> None:
    dancer = make_dancer(2, frame=[4, 5, 6, 7, 8], time_s=[0.1, 0.2, 0.3, 0.4, 0.5])
    assert repr(track()) == (
        "Track2D(dancer 1: 7 frames, 0 to 6, 0.000 to 0.240 s; 17 keypoints of coco17)"
    )
    assert "dancer 2: 5 frames, 4 to 8" in repr(dancer.smoothed)
    assert "body heights, no path" in repr(dancer.smoothed)
    assert repr(dancer) == "Dancer(2: 5 frames, 4 to 8, 0.100 to 0.500 s, shot 0)"


def test_the_tracks_of_a_dancer_belong_together() -> None:
    dancer = make_dancer(2, frame=[4, 5, 6, 7, 8], time_s=[0.1, 0.2, 0.3, 0.4, 0.5])
    with pytest.raises(ValueError, match="one person in one shot"):
        replace(dancer, raw=replace(dancer.raw, shot=3))
    with pytest.raises(ValueError, match="one timeline"):
        later = Timeline(dancer.timeline.frame, dancer.timeline.time_s + 1)
        Dancer(dancer.keypoints, replace(dancer.raw, timeline=later), dancer.smoothed)
