"""Level floors: planted cameras that look down are found, and the dancers put on the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.lifting.world.camera_tilt import camera_tilt_deg
from dance2pose.lifting.world.ground_plane import levelled
from dance2pose.poses import FloatArray, Timeline, Track3D
from dance2pose.skeleton import get

FRAMES, JOINTS = 70, 17
BODY = get("body17")
FLOOR_MM = 65.0  # of ankles above their soles


def standing() -> FloatArray:
    """One upright body (J, 3), body heights, pelvis at the origin, ankles 0.46 below it."""
    xyz = np.zeros((JOINTS, 3))
    for joint, name in enumerate(BODY.joints):
        side = 0.1 if name.startswith("left") else -0.1 if name.startswith("right") else 0.0
        height = {"knee": -0.23, "ankle": -0.46, "toe": -0.5, "head": 0.45, "neck": 0.33}
        part = name.split("_")[-1]
        xyz[joint] = side, height.get(part, 0.3 if part in ("shoulder", "elbow", "wrist") else 0), 0
    return xyz - xyz[0]


def seen_by_tilted_camera(tilt_deg: float, *, lean_deg: float = 0.0, far: float = 2.0) -> Track3D:
    """Steps to the back and a stop each, as a camera 0.9 above the floor sees them (its axes)."""
    body = standing() @ Rotation.from_euler("x", lean_deg, degrees=True).as_matrix().T
    steps = np.repeat(np.linspace(0.0, 1.0, FRAMES // 10), 10)
    root = np.zeros((FRAMES, 3))
    root[:, 1] = 0.46 + FLOOR_MM / BODY_HEIGHT_MM - 0.9
    root[:, 2] = -2.5 - far * steps
    turn = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    return Track3D(
        person=1,
        timeline=Timeline(np.arange(FRAMES), np.arange(FRAMES) / 25.0),
        xyz=np.repeat((body @ turn.T)[None], FRAMES, axis=0),
        unit="body heights",
        skeleton="body17",
        reprojection_error=np.zeros((FRAMES, JOINTS)),
        valid=np.ones((FRAMES, JOINTS - 1), bool),
        estimated=np.zeros((FRAMES, JOINTS), bool),
        root=root @ turn.T,
    )


@pytest.mark.parametrize("tilt", [-10.0, 0.0, 25.0, 50.0])
def test_the_camera_is_levelled_and_feet_stand_on_the_floor(tilt: float) -> None:
    track = seen_by_tilted_camera(tilt)
    assert camera_tilt_deg([track], BODY_HEIGHT_MM) == pytest.approx(tilt, abs=1.0)
    (world,) = levelled([track], BODY_HEIGHT_MM)
    assert world.root is not None
    ankles = world.xyz[:, BODY.index("left_ankle")] + world.root
    np.testing.assert_allclose(ankles[:, 1], FLOOR_MM / BODY_HEIGHT_MM, atol=0.03)
    # Lengths and angles are untouched.
    np.testing.assert_allclose(
        np.linalg.norm(world.xyz, axis=-1), np.linalg.norm(track.xyz, axis=-1), atol=1e-12
    )


def test_feet_near_and_far_correct_a_body_that_leans() -> None:
    leaning = seen_by_tilted_camera(20.0, lean_deg=9.0, far=3.0)
    on_one_spot = seen_by_tilted_camera(20.0, lean_deg=9.0, far=0.0)
    found = camera_tilt_deg([leaning], BODY_HEIGHT_MM)
    fooled = camera_tilt_deg([on_one_spot], BODY_HEIGHT_MM)
    assert abs(found - 20.0) < 2.0 < abs(fooled - 20.0)


def test_dancers_of_one_camera_share_its_tilt_and_those_without_a_path_stay() -> None:
    upright = seen_by_tilted_camera(30.0)
    bowing = replace(seen_by_tilted_camera(30.0, lean_deg=12.0, far=0.0), person=2)
    no_path = replace(upright, root=None, person=3)
    first, second, third = levelled([upright, bowing, no_path], BODY_HEIGHT_MM)
    turn, _ = Rotation.align_vectors(first.xyz[0], upright.xyz[0])
    np.testing.assert_allclose(second.xyz, bowing.xyz @ turn.as_matrix().T, atol=1e-6)
    np.testing.assert_array_equal(third.xyz, no_path.xyz)
    assert third.root is None


def test_frames_without_a_pose_stay_unknown() -> None:
    track = seen_by_tilted_camera(15.0)
    assert track.root is not None
    track.xyz[20:33], track.root[20:33] = np.nan, np.nan
    (world,) = levelled([track], BODY_HEIGHT_MM)
    assert world.root is not None
    assert np.isnan(world.xyz[20:33]).all() and np.isnan(world.root[20:33]).all()
    assert np.isfinite(np.delete(world.xyz, range(20, 33), axis=0)).all()
    nothing = replace(track, xyz=track.xyz * np.nan, root=track.root * np.nan)
    assert np.isnan(levelled([nothing], BODY_HEIGHT_MM)[0].xyz).all()
