"""Bone lengths of a track where keypoints are wrong for much of it."""

from __future__ import annotations

import numpy as np

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal.bones import likely_projections


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
