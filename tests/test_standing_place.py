"""Where poses stand: planted places found, bones that lie across the view telling most."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.body import body_bones_mm, retarget
from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.lifting.world.standing_place import place
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get
from lifting_examples import posed

TREE = get("cmu17")
T, J = 7, len(TREE)


def seen_at(xyz: FloatArray, root: FloatArray) -> FloatArray:
    """(T, J, 2), as parts of the focal length."""
    at = xyz + root[:, None]
    return np.asarray(at[..., :2] / -at[..., 2:])


def errors(pose: float = 30.0, noise: float = 1.0) -> ErrorParts:
    return ErrorParts(np.full((T, J), pose), np.full((T, J), noise), 0.0)


@given(
    seed=st.integers(0, 99),
    x=st.floats(-2000, 2000),
    y=st.floats(-800, 800),
    away=st.floats(2000, 9000),
    pose=st.floats(0, 80),
    noise=st.floats(0, 20),
)
@settings(max_examples=30, deadline=None)
def test_an_exact_pose_is_put_where_it_was_whatever_its_errors_are_thought_to_be(
    seed: int, x: float, y: float, away: float, pose: float, noise: float
) -> None:
    xyz = posed("cmu17", T, seed)
    root = np.array([x, y, -away]) + np.arange(T)[:, None] * [30.0, -5.0, 40.0]
    found = place(xyz, seen_at(xyz, root), np.ones((T, J)), errors(pose, noise), TREE)
    np.testing.assert_allclose(found.at, root, atol=1e-3)
    assert (found.along > found.across).all() and (found.across > 0).all()


def test_bones_across_the_view_tell_the_distance_although_others_err() -> None:
    straight = posed("cmu17", T, 3)
    straight[..., 2] *= 0.1  # across the view ...
    arms = [
        TREE.index(f"{side}_{part}") for side in ("left", "right") for part in ("elbow", "wrist")
    ]
    straight[:, arms, 2] += [300.0, 500.0, 300.0, 500.0]  # ... but for the arms
    true = retarget(straight, TREE, body_bones_mm("cmu17"))
    wrong = true.copy()
    wrong[:, arms, 2] *= 0.4  # believed to be less foreshortened than they are
    wrong = retarget(wrong, TREE, body_bones_mm("cmu17"))
    root = np.tile([200.0, 100.0, -4000.0], (T, 1))
    depth = np.full((T, J), 5.0)
    depth[:, arms] = 150.0
    flat, sure = seen_at(true, root), np.ones((T, J))
    noise = np.ones((T, J))
    weighed = place(wrong, flat, sure, ErrorParts(depth, noise, 0.0), TREE)
    alike = place(wrong, flat, sure, ErrorParts(np.zeros((T, J)), noise, 0.0), TREE)
    off = np.abs(weighed.at - root)[:, 2].mean()
    assert off < 0.2 * np.abs(alike.at - root)[:, 2].mean()
    assert off < 20.0


def test_joints_that_were_not_seen_do_not_matter_and_frames_without_any_are_unknown() -> None:
    xyz = posed("cmu17", T, 5)
    root = np.tile([-300.0, 50.0, -3500.0], (T, 1))
    flat, sure = seen_at(xyz, root), np.ones((T, J))
    flat[:, 4], flat[2, 6:], flat[3] = np.nan, np.nan, np.nan
    flat[:, 7], sure[:, 7] = 5.0, 0.0
    flat[5] = flat[5, :1]  # all at one point
    unknown = xyz.copy()
    unknown[6] = np.nan
    found = place(unknown, flat, sure, errors(), TREE)
    np.testing.assert_allclose(found.at[[0, 1, 2, 4]], root[[0, 1, 2, 4]], atol=0.5)
    for values in (found.at, found.along, found.across):
        assert np.isnan(values[[3, 5, 6]]).all()
    assert found.along[2] > found.along[1]  # fewer joints, less sure
