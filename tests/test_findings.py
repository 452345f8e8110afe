"""What is said of a result before use: each thing planted is named, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dance2pose.findings import find, turns_deg
from dance2pose.poses import Dancer, Timeline, Track2D, Track3D
from dance2pose.skeleton import get
from dance2pose.viewpoint import Viewpoint

T, J = 40, 17
TIMELINE = Timeline.regular(T, rate_hz=25)
BODY = np.random.default_rng(1).normal(0, 0.2, (J, 3))
BODY -= BODY[0]


def dancer(person: int = 1, rows: int = T) -> Dancer:
    """A body that stands still above the floor."""
    timeline = Timeline(TIMELINE.frame[:rows], TIMELINE.time_s[:rows])
    xy = 200 + 400 * np.repeat(BODY[None, :, :2], rows, axis=0)
    track = Track2D.from_arrays(
        xy, skeleton="body17", time_s=timeline.time_s, image_size=(640, 480), person=person
    )
    lowest = BODY[:, 1].min()
    poses = Track3D(
        person=person,
        timeline=timeline,
        xyz=np.repeat(BODY[None], rows, axis=0),
        unit="metres",
        skeleton="body17",
        reprojection_error=np.full((rows, J), 1.0),
        valid=np.ones((rows, J - 1), bool),
        estimated=np.zeros((rows, J), bool),
        root=np.tile([0.0, -lowest, -4.0], (rows, 1)),
    )
    return Dancer(track, poses, poses)


def said(*dancers: Dancer, everyone: list[Track2D] | None = None) -> str:
    tracks = everyone if everyone is not None else [d.keypoints for d in dancers]
    return "\n".join(find(dancers, tracks, TIMELINE))


def test_nothing_is_said_of_what_is_as_it_should_be() -> None:
    assert said(dancer()) == ""


def test_a_sudden_turn_is_named_with_its_joint_and_time() -> None:
    one = dancer()
    xyz = one.smoothed.xyz.copy()
    elbow, wrist = (get("body17").index(f"left_{name}") for name in ("elbow", "wrist"))
    xyz[20, wrist] = 2 * xyz[20, elbow] - xyz[20, wrist]
    text = said(replace(one, smoothed=replace(one.smoothed, xyz=xyz)))
    assert "2 sudden turns" in text and "left wrist, 180 degrees" in text
    assert "0.80 s" in text or "0.84 s" in text


def test_a_turn_across_a_hole_in_time_is_none() -> None:
    xyz = np.stack([BODY, -BODY])
    apart = Timeline(np.array([0, 50]), np.array([0.0, 2.0]))
    assert np.isnan(turns_deg(xyz, apart, "body17")).all()
    near = Timeline(np.array([0, 1]), np.array([0.0, 0.04]))
    np.testing.assert_allclose(turns_deg(xyz, near, "body17"), 180, atol=1e-4)


def test_joints_far_from_their_keypoints_are_named() -> None:
    one = dancer()
    error = one.smoothed.reprojection_error.copy()
    error[7, 3], error[8:20, 7] = 304.0, 117.0
    text = said(replace(one, raw=replace(one.raw, reprojection_error=error)))
    assert "304 px" in text and get("body17").joints[3].replace("_", " ") in text


def test_feet_under_the_floor_are_named() -> None:
    one = dancer()
    root = one.smoothed.root.copy()  # type: ignore[union-attr]
    root[5:9, 1] -= 0.11
    text = said(replace(one, smoothed=replace(one.smoothed, root=root)))
    assert "in 4 of 40 frames, by up to 0.11 metres" in text


def test_a_dancer_seen_in_part_and_people_left_out_are_named() -> None:
    first, second, third = dancer(1), dancer(2, rows=15), dancer(3, rows=30)
    text = said(first, second, everyone=[d.keypoints for d in (first, second, third)])
    assert "dancer 2: seen in 15 of 40 frames" in text
    assert "dancer 1" not in text
    assert "person 3, seen from 0.0 to 1.2 s, was left out" in text and "--person 3" in text


@pytest.mark.parametrize("rows", [1, 2])
def test_very_short_tracks_are_no_trouble(rows: int) -> None:
    assert "seen in" in said(dancer(rows=rows))


def placed(distance: float, floor: float = 0.0) -> Dancer:
    """Someone who stands that far from the camera, on a floor of that height, metres."""
    made = dancer()
    root = np.tile([0.0, floor + 0.55, 0.0], (T, 1))
    upright = np.zeros_like(made.smoothed.xyz)
    ankles = [get(made.smoothed.skeleton).index(f"{side}_ankle") for side in ("left", "right")]
    upright[:, ankles, 1] = -0.55 + 0.065
    seen = Viewpoint(
        np.broadcast_to(np.eye(3), (T, 3, 3)),
        np.array([0.0, floor + 0.55, distance]),
        np.full(T, 1000.0),
        (640, 480),
    )
    smoothed = replace(made.smoothed, xyz=upright, root=root, viewpoint=seen)
    return replace(made, smoothed=smoothed)


def test_a_distance_that_cannot_be_is_named_with_the_field_of_view() -> None:
    assert "would be 0.18 metres from the camera" in said(placed(0.18))
    assert "camera" not in said(placed(3.0))


def test_a_dancer_on_a_floor_above_the_others_is_named() -> None:
    low, high = placed(3.0), placed(3.0, floor=1.2)
    assert "stands on a floor of its own, 1.20 metres above" in said(low, high)
    assert "floor of its own" not in said(low, low)
