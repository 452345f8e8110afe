"""What is drawn besides joints: as the camera sees them, standing feet, facing, the unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.lifting.world.root_trajectory import ANKLE_ABOVE_FLOOR_MM
from dance2pose.poses import Dancer, FloatArray, Track3D
from dance2pose.recording import overlays
from dance2pose.recording.layout import _eye
from dance2pose.skeleton import get
from dance2pose.viewpoint import Viewpoint
from recording_making import make_dancer

FRAMES = 7
BODY = get("body17")


@pytest.fixture
def dancer() -> Dancer:
    ground = np.tile([0.0, 0.5 + ANKLE_ABOVE_FLOOR_MM / 1650, 0.0], (FRAMES, 1))
    made = make_dancer(
        frame=list(range(FRAMES)), time_s=[n / 25 for n in range(FRAMES)], root=ground
    )
    seen = Viewpoint(
        np.broadcast_to(np.eye(3), (FRAMES, 3, 3)),
        np.array([0.2, 1.0, 3.0]),
        np.full(FRAMES, 100.0),
        (128, 96),
    )
    still = np.repeat(made.smoothed.xyz[:1], FRAMES, axis=0)
    return replace(made, smoothed=replace(made.smoothed, xyz=still, viewpoint=seen))


def test_the_skeleton_is_drawn_where_the_camera_sees_it(dancer: Dancer) -> None:
    drawn = overlays.drawn_over_picture(dancer)
    assert drawn is not None
    bones, known = drawn
    assert known.all()
    neck = dancer.smoothed.xyz[2, 1] + dancer.smoothed.root[2]  # type: ignore[index]
    x, y, z = neck - [0.2, 1.0, 3.0]
    np.testing.assert_allclose(bones[2, 0, 1], [63.5 - 100 * x / z, 47.5 + 100 * y / z])


def test_a_camera_that_turned_draws_the_same_place_elsewhere(dancer: Dancer) -> None:
    seen = dancer.smoothed.viewpoint
    assert seen is not None
    pan = Rotation.from_euler("y", [-5], degrees=True).as_matrix()  # to the right
    turned = replace(seen, rotation=pan @ seen.rotation)
    place = np.zeros((FRAMES, 1, 3))
    assert (turned.project(place)[..., 0] < seen.project(place)[..., 0]).all()
    assert np.isnan(seen.project(np.full((FRAMES, 1, 3), 4.0))).all(), "it is behind the camera"


def test_without_a_viewpoint_nothing_is_drawn_over_the_picture(dancer: Dancer) -> None:
    unknown = replace(dancer, smoothed=replace(dancer.smoothed, viewpoint=None))
    assert overlays.drawn_over_picture(unknown) is None


def test_joints_that_no_keypoint_saw_are_apart(dancer: Dancer) -> None:
    estimated = np.zeros((FRAMES, 17), bool)
    estimated[3:, BODY.index("left_toe")] = True
    track = replace(dancer.smoothed, estimated=estimated)
    assert np.isnan(overlays.known_joints(track)[3:, BODY.index("left_toe")]).all()
    assert not np.isnan(overlays.known_joints(track)[:3]).any()
    assert [len(bones) for bones in overlays.guessed_bones(track)] == [0, 0, 0, 1, 1, 1, 1]


def _feet_on_floor(track: Track3D) -> FloatArray:
    return overlays.feet_on_floor(track, overlays.standing(track))


def test_feet_that_stand_are_marked(dancer: Dancer) -> None:
    feet = _feet_on_floor(dancer.smoothed)
    assert np.isfinite(feet).all()
    rising = np.array(dancer.smoothed.root)
    rising[:, 1] += np.linspace(0, 3, FRAMES)
    assert np.isnan(_feet_on_floor(replace(dancer.smoothed, root=rising))).all()
    assert np.isnan(_feet_on_floor(replace(dancer.smoothed, root=None))).all()


@pytest.mark.parametrize("degrees", [0.0, 90.0, -30.0])
def test_facing_follows_the_turn_of_the_body(dancer: Dancer, degrees: float) -> None:
    turn = Rotation.from_euler("y", degrees, degrees=True)
    track = dancer.smoothed
    turned = replace(track, xyz=turn.apply(track.xyz.reshape(-1, 3)).reshape(track.xyz.shape))
    expected = turn.apply(overlays.facing(track))
    np.testing.assert_allclose(overlays.facing(turned), expected, atol=1e-9)
    assert overlays.facing(track)[0, 2] > 0.9, "it faces the viewer"


def test_the_eye_stands_where_the_camera_stood_or_behind_it(dancer: Dancer) -> None:
    centre, near, far = np.array([0.0, 0.5, 0.0]), np.full(3, 0.5), np.array([9.0, 2.0, 1.0])
    np.testing.assert_allclose(_eye([dancer], centre, near), [0.2, 1.0, 3.0])
    back = _eye([dancer], centre, far) - centre
    assert np.linalg.norm(back) > 5
    np.testing.assert_allclose(back / np.linalg.norm(back), [0.0657, 0.1644, 0.9842], atol=0.01)


def test_the_ruler_has_numbers_at_even_places() -> None:
    points = np.array([[-1.2, 0.0, -0.3], [0.9, 1.7, 0.4], [np.nan] * 3])
    lines, places, labels = overlays.ruler(points, "metres")
    assert len(lines) == 3 and len(places) == len(labels)
    assert "x -1 m" in labels and "y 1.5 m" in labels and "z 0 m" in labels
    assert overlays.ruler(points[2:], "metres") == ([], pytest.approx(np.zeros((0, 3))), [])
