"""Keypoints that no body could have put there are left out; those of real bodies never are."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.lifting.implausible import implausible
from dance2pose.lifting.one_track import observe
from dance2pose.poses import FloatArray, Track2D
from dance2pose.skeleton import get
from lifting_examples import posed

T, J = 31, 17
BODY = get("body17")
TIME_S = np.arange(T) / 25


def seen(frames: int = T) -> FloatArray:
    """px, of real poses, 0.4 px a mm."""
    return 0.4 * posed("body17", frames)[..., :2] + 500


def test_a_wrist_on_the_other_side_of_the_picture_is_found_alone() -> None:
    xy = seen()
    wrist = BODY.index("right_wrist")
    xy[10:14, wrist] += [600.0, 0.0]
    bad = implausible(xy, TIME_S, "body17")
    assert bad[10:14, wrist].all()
    assert bad.sum() == 4


def test_a_knee_that_is_wrong_is_accused_by_both_its_bones() -> None:
    xy = seen()
    knee = BODY.index("left_knee")
    xy[5:9, knee] += [0.0, -700.0]
    bad = implausible(xy, TIME_S, "body17")
    assert bad[5:9, knee].all() and bad.sum() == 4


@pytest.mark.parametrize("seed", range(5))
def test_poses_of_all_kinds_pass(seed: int) -> None:
    xy = 0.4 * posed("body17", T, seed)[..., :2]
    assert not implausible(xy, TIME_S, "body17").any()


def test_missing_keypoints_and_empty_tracks_are_no_trouble() -> None:
    xy = seen()
    xy[3] = np.nan
    xy[:, 4] = np.nan
    assert not implausible(xy, TIME_S, "body17").any()
    assert implausible(xy[:0], TIME_S[:0], "body17").shape == (0, J)
    assert not implausible(np.zeros((T, J, 2)), TIME_S, "body17").any()


def test_lifters_are_not_given_them() -> None:
    xy = seen() * [1.0, -1.0]
    wrist = BODY.index("right_wrist")
    xy[10:14, wrist] += [600.0, 0.0]
    track = Track2D.from_arrays(xy, time_s=TIME_S, skeleton="body17", image_size=(1920, 1080))
    given = observe(track)
    assert np.isnan(given.xy[10:14, wrist]).all() and (given.confidence[10:14, wrist] == 0).all()
    assert np.isfinite(observe(track, independent=True).xy).all()
