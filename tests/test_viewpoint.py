"""A camera in the world of a track."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.viewpoint import Viewpoint

T = 7


def test_an_aimed_camera_sees_places_where_others_were_seen_before() -> None:
    random = np.random.default_rng(3)
    camera = Viewpoint(
        Rotation.from_rotvec(random.normal(0, 0.2, (T, 3))).as_matrix(),
        np.array([0.3, 1.1, 5.0]),
        random.uniform(500, 900, T),
        (640, 480),
    )
    before, after = random.normal(0, 0.5, (2, T, 3))
    after[2] = before[4] = np.nan
    known = [0, 1, 3, 5, 6]
    aimed = camera.aimed(before, after)
    np.testing.assert_allclose(
        aimed.project(after[:, None])[known], camera.project(before[:, None])[known], atol=1e-9
    )
    np.testing.assert_array_equal(aimed.rotation[[2, 4]], camera.rotation[[2, 4]])
    upright = aimed.rotation.transpose(0, 2, 1) @ aimed.rotation
    np.testing.assert_allclose(upright, np.broadcast_to(np.eye(3), (T, 3, 3)), atol=1e-12)


def test_a_camera_that_is_aimed_at_nothing_stays() -> None:
    camera = Viewpoint(np.eye(3)[None], np.zeros(3), np.array([500.0]), (640, 480))
    nowhere = np.full((1, 3), np.nan)
    np.testing.assert_array_equal(camera.aimed(nowhere, nowhere).rotation, camera.rotation)
