"""The field of view: told by the floor under upright dancers, or else assumed and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.lifting.lift import describe_camera
from dance2pose.lifting.world.field_of_view import estimated_fov
from dance2pose.lifting.world.perspective import camera_of
from dance2pose.options import LiftOptions
from dance2pose.poses import Track3D
from dance2pose.viewpoint import Viewpoint
from test_levelling import seen_by_tilted_camera


def taken_for(track: Track3D, true_deg: float, assumed_deg: float) -> Track3D:
    """The track as it comes out where a wrong field of view is assumed."""
    assert track.root is not None
    longer = np.tan(np.radians(true_deg) / 2) / np.tan(np.radians(assumed_deg) / 2)
    return replace(track, root=track.root * [1.0, 1.0, longer])


def seen_from_above(tilt_deg: float, far: float) -> Track3D:
    """A dancer on the axis of a camera that looks down, on average."""
    track = seen_by_tilted_camera(tilt_deg, far=far)
    assert track.root is not None
    higher = (2.5 + far / 2) * np.tan(np.radians(tilt_deg)) - 0.4
    down = Rotation.from_euler("x", tilt_deg, degrees=True).apply([0.0, -higher, 0.0])
    return replace(track, root=track.root + down)


@pytest.mark.parametrize("true_deg", [38.0, 50.0, 66.0])
def test_a_planted_field_of_view_is_found_within_its_error(true_deg: float) -> None:
    seen = taken_for(seen_from_above(25.0, far=3.0), true_deg, 50.0)
    found = estimated_fov([seen], BODY_HEIGHT_MM, 50.0)
    assert found is not None
    assert 2 < found.error_deg < 10
    assert abs(found.degrees - true_deg) < 1.2 * found.error_deg
    if true_deg != 50:
        assert abs(found.degrees - true_deg) < 0.6 * abs(50 - true_deg)


@pytest.mark.parametrize(
    ("tilt", "far"), [(2.0, 3.0), (30.0, 0.0)], ids=["a level camera", "one spot"]
)
def test_where_the_picture_does_not_tell_nothing_is_claimed(tilt: float, far: float) -> None:
    assert estimated_fov([seen_from_above(tilt, far)], BODY_HEIGHT_MM, 50.0) is None
    assert estimated_fov([], BODY_HEIGHT_MM, 50.0) is None


def test_one_meaning_across_the_longer_side() -> None:
    upright, wide = camera_of((1080, 1920), 60.0), camera_of((1920, 1080), 60.0)
    assert upright.focal_px == pytest.approx(wide.focal_px)
    seen = Viewpoint(np.eye(3)[None], np.zeros(3), np.array([upright.focal_px]), (1080, 1920))
    assert seen.fov_deg == pytest.approx(60.0)


def test_what_was_taken_is_said() -> None:
    track = seen_by_tilted_camera(30.0)
    frames = len(track)
    seen = Viewpoint(
        np.broadcast_to(np.eye(3), (frames, 3, 3)),
        np.zeros(3),
        np.full(frames, camera_of((640, 480), 44.0).focal_px),
        (640, 480),
        fov_error_deg=6.0,
    )
    told = describe_camera(LiftOptions(), None, [replace(track, viewpoint=seen)])
    assert "44 degrees across the longer side of the picture, give or take 6" in told
    assert "assumed to be 50 degrees" in describe_camera(LiftOptions(), None, [track])
    assert "as given" in describe_camera(LiftOptions(fov_deg=44.0), None, [track])
