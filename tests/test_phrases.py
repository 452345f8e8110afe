"""Key poses and phrases of planted motion that comes to rest at known times."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.phrases import find_phrases, motion_energy
from dance2pose.poses import Timeline, Track3D
from export_making import make_poses, variable_times, with_gap


def resting_every(period_s: float, times: np.ndarray) -> Track3D:
    """The planted dance at a speed that falls to zero at every whole multiple of the period."""
    danced = times - np.sin(2 * np.pi * times / period_s) * period_s / (2 * np.pi)
    poses = make_poses(2 * danced, rooted=False)
    frame = np.arange(len(times), dtype=np.int64)
    return dataclasses.replace(poses, timeline=Timeline(frame, times))


@pytest.mark.parametrize("times", [np.arange(0, 12, 1 / 25), variable_times(720)])
def test_rests_divide_phrases_and_are_key_poses(times: np.ndarray) -> None:
    phrases = find_phrases(resting_every(3.0, times))
    assert [p.number for p in phrases] == [1, 2, 3, 4]
    np.testing.assert_allclose([p.start_s for p in phrases], [times[0], 3, 6, 9], atol=0.1)
    assert all(one.end_s == other.start_s for one, other in pairwise(phrases))
    rests = [pose.time_s for phrase in phrases for pose in phrase.key_poses]
    for rest in (3, 6, 9):
        assert np.abs(np.array(rests) - rest).min() < 0.1


def test_a_gap_and_a_hole_in_time_end_a_phrase() -> None:
    times = np.arange(0, 8, 1 / 25)
    steady = make_poses(times, rooted=False)
    broken = find_phrases(with_gap(steady, slice(100, 110)))
    assert times[99] in [p.end_s for p in broken]
    assert times[110] in [p.start_s for p in broken]
    later = np.where(times < 4, times, times + 60)
    apart = find_phrases(dataclasses.replace(steady, timeline=Timeline(steady.frame, later)))
    assert not any(p.start_s < 4 < p.end_s for p in apart)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.1, 10))
def test_energy_is_that_of_a_known_speed(speed: float) -> None:
    times = np.array([0, 0.03, 0.07, 0.1, 0.15])
    xyz = np.zeros((5, 3, 3))
    xyz[:, 1, 0] = speed * times  # one joint of three moves
    np.testing.assert_allclose(motion_energy(times, xyz), speed**2 / 3)


def test_stillness_and_too_few_frames_have_no_rest_in_them() -> None:
    still = make_poses(np.arange(50) / 25)
    same = dataclasses.replace(still, xyz=np.repeat(still.xyz[:1], 50, axis=0), root=None)
    (phrase,) = find_phrases(same)
    assert phrase.energy < 1e-20 and phrase.key_poses == ()
    assert find_phrases(make_poses(np.arange(2) / 25)) == ()


def test_phrases_do_not_change_with_the_unit() -> None:
    times = np.arange(0, 9, 1 / 25)
    metres = resting_every(3.0, times)
    other = dataclasses.replace(metres, xyz=metres.xyz / 1.65, unit="body heights")
    assert [p.start_s for p in find_phrases(metres)] == [p.start_s for p in find_phrases(other)]
