"""Sigma grows where a keypoint jumps, by about what it jumped, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dance2pose.lifting.jumps import doubted_where_keypoints_jump
from dance2pose.poses import Timeline, Track2D, Track3D

T, J = 30, 17
PX_PER_METRE = 200.0


def pair(error: np.ndarray, *, sigma: bool = True) -> tuple[Track3D, Track2D]:
    body = np.random.default_rng(4).normal(0, 0.4, (J, 3))
    xyz = np.repeat((body - body[0])[None], T, axis=0)
    timeline = Timeline.regular(T, rate_hz=25)
    poses = Track3D(
        person=1,
        timeline=timeline,
        xyz=xyz,
        unit="metres",
        skeleton="body17",
        reprojection_error=error,
        valid=np.ones((T, J - 1), bool),
        estimated=np.zeros((T, J), bool),
        sigma=np.full((T, J), 0.05) if sigma else None,
    )
    xy = PX_PER_METRE * xyz[..., :2] * [1, -1] + 300
    return poses, Track2D.from_arrays(xy, skeleton="body17", time_s=timeline.time_s)


def test_sigma_grows_by_what_a_keypoint_jumped() -> None:
    error = np.random.default_rng(5).uniform(1.0, 2.0, (T, J))
    error[11, 7] = 100.0  # half a metre
    error[4, 3] = np.nan
    poses, track = pair(error)
    found = doubted_where_keypoints_jump(poses, track).sigma
    assert found is not None and poses.sigma is not None
    usual = np.nanmedian(error[:, 7])
    expected = np.hypot(0.05, (100.0 - 3 * usual) / PX_PER_METRE)
    np.testing.assert_allclose(found[11, 7], expected, rtol=1e-6)
    others = np.ones((T, J), bool)
    others[11, 7] = False
    np.testing.assert_array_equal(found[others], poses.sigma[others])


def test_without_jumps_or_sigma_nothing_changes() -> None:
    poses, track = pair(np.full((T, J), 1.5))
    assert doubted_where_keypoints_jump(poses, track) is poses
    bare, track = pair(np.full((T, J), np.nan), sigma=False)
    assert doubted_where_keypoints_jump(bare, track) is bare
    unseen = replace(poses, reprojection_error=np.full((T, J), np.nan))
    assert doubted_where_keypoints_jump(unseen, track) is unseen
