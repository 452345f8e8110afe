"""How far keypoints err, told by the track: jitter, errors that last, bones that nobody has."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal.keypoint_errors import jitter, likely_projections, of_lengths
from dance2pose.poses import FloatArray


def test_a_bone_that_no_such_body_has_gets_the_likely_length() -> None:
    body = body_bones_mm("body17")
    longest = 0.5 * body
    longest[[3, 6]] *= 1.9  # both forearms: wrists that were taken for something else
    longest[8] *= 0.6  # a bone that never lay across the view is no error
    longest[11] = np.nan
    found = likely_projections(longest, body)
    np.testing.assert_allclose(found[[3, 6]], 0.5 * body[[3, 6]])
    kept = [i for i in range(len(body)) if i not in (3, 6)]
    np.testing.assert_array_equal(found[kept], longest[kept])


def test_nothing_seen_stays_nothing() -> None:
    body = body_bones_mm("cmu17")
    assert np.isnan(likely_projections(np.full(len(body), np.nan), body)).all()


LENGTHS = body_bones_mm("cmu17")


def turning(frames: int, error_mm: float, seed: int) -> FloatArray:
    """Bones (N, B, 3) of the one body, mostly across the view, whose ends were seen with errors."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(frames, len(LENGTHS), 3)) * [1.0, 1.0, 0.3]
    bone = direction / np.linalg.norm(direction, axis=-1, keepdims=True) * LENGTHS[:, None]
    bone[..., :2] += rng.normal(0, np.sqrt(2) * error_mm, (frames, len(LENGTHS), 2))
    return np.asarray(bone)


@pytest.mark.parametrize("error_mm", [5.0, 15.0, 25.0])
def test_a_planted_error_is_found_from_how_bones_vary(error_mm: float) -> None:
    bone = turning(200, error_mm, 1)
    found = of_lengths(bone, np.full(bone.shape[:2], 4.0), LENGTHS)
    assert found == pytest.approx(error_mm, rel=0.2)


def test_exact_keypoints_have_no_error_and_nothing_seen_tells_nothing() -> None:
    bone = turning(200, 0.0, 2)
    variance = np.full(bone.shape[:2], 4.0)
    assert of_lengths(bone, variance, LENGTHS) < 0.5
    assert of_lengths(np.full(bone.shape, np.nan), variance, LENGTHS) == 0.0


def test_depths_that_are_uncertain_are_not_taken_for_errors_of_the_picture() -> None:
    bone = turning(300, 10.0, 3)
    bone[..., 2] += np.random.default_rng(4).normal(0, 30.0, bone.shape[:2])
    variance = np.full(bone.shape[:2], 30.0**2 / 0.3)
    assert of_lengths(bone, variance, LENGTHS) == pytest.approx(10.0, rel=0.35)


def test_jitter_is_found_and_an_unsure_keypoint_has_more() -> None:
    rng = np.random.default_rng(5)
    way = np.linspace(0, 900, 90)[:, None, None] + np.zeros((90, 3, 2))
    confidence = np.ones((90, 3))
    confidence[:, 2] = 0.5
    found = jitter(way + rng.normal(0, 8.0, way.shape), confidence)
    np.testing.assert_allclose(found[0, :2], 8.0, rtol=0.3)
    assert found[0, 2] == pytest.approx(2 * 8.0, rel=0.3)
