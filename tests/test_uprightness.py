"""The camera's tilt as bodies and floors tell it, and how firmly feet stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.lifting.world.camera_tilt import camera_tilt_deg, tilt_evidence
from dance2pose.lifting.world.contact import contacts, firmness, foot_joints
from dance2pose.lifting.world.uprightness import above_feet, centre_of_mass, upright_frames
from dance2pose.poses import Timeline, Track3D
from dance2pose.skeleton import get
from test_levelling import seen_by_tilted_camera, standing

BODY = get("body17")
J = len(BODY)


def test_the_centre_of_mass_is_that_of_its_parts() -> None:
    body = standing()[None]
    (above,) = above_feet(body, BODY)
    # Between hip and navel, over the feet.
    assert 0.4 < above[1] < 0.6 and np.abs(above[[0, 2]]).max() < 1e-9
    aside = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        centre_of_mass(body + aside, BODY), centre_of_mass(body, BODY) + aside
    )
    raised = body.copy()
    raised[:, [BODY.index("left_wrist")]] += [0.0, 1.0, 0.0]
    moved = centre_of_mass(raised, BODY) - centre_of_mass(body, BODY)
    assert moved[0, 1] == pytest.approx(0.022 / 2)  # half a forearm; all parts make 1


def test_the_taller_half_is_upright_and_unknown_frames_are_not() -> None:
    above = np.tile([0.0, 1.0, 0.0], (7, 1)) * np.array([5, 1, 4, 2, 6, 3, np.nan])[:, None]
    np.testing.assert_array_equal(upright_frames(above), [1, 0, 1, 0, 1, 0, 0])
    assert not upright_frames(np.full((7, 3), np.nan)).any()


def runner(tilt_deg: float, lean_deg: float) -> Track3D:
    """Runs away from the camera, leaning, on feet that never stand; the pelvis stays level."""
    frames = 45
    track = seen_by_tilted_camera(tilt_deg, lean_deg=lean_deg)
    back = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()
    root = np.zeros((frames, 3))
    root[:, 1] = -0.4 + 0.02 * np.sin(np.arange(frames))
    root[:, 2] = -2.0 - np.linspace(0, 2.5, frames)
    return replace(
        track,
        timeline=Timeline(np.arange(frames), np.arange(frames) / 25.0),
        xyz=track.xyz[:frames],
        reprojection_error=np.zeros((frames, J)),
        valid=np.ones((frames, J - 1), bool),
        estimated=np.zeros((frames, J), bool),
        root=root @ back.T,
    )


@pytest.mark.parametrize("tilt", [-3.0, 12.0])
def test_the_pelvis_of_a_runner_tells_the_floor_that_no_foot_does(tilt: float) -> None:
    track = runner(tilt, lean_deg=-14.0)
    evidence = tilt_evidence([track], BODY_HEIGHT_MM)
    assert abs(evidence.upright_deg - tilt) > 8  # fooled by the lean
    assert len(evidence.planes) == 1  # no feet
    assert camera_tilt_deg([track], BODY_HEIGHT_MM) == pytest.approx(tilt, abs=1.5)


def test_a_plane_is_the_surer_the_farther_it_reaches() -> None:
    errors = [
        tilt_evidence([seen_by_tilted_camera(20.0, far=far)], BODY_HEIGHT_MM).plane[1]
        for far in (0.5, 1.0, 3.0)
    ]
    assert errors == sorted(errors, reverse=True) and errors[0] > 2 * errors[2]
    nothing = tilt_evidence([], BODY_HEIGHT_MM)
    assert np.isnan(nothing.upright_deg) and np.isnan(nothing.plane[0])
    assert camera_tilt_deg([], BODY_HEIGHT_MM) == 0.0


def test_who_climbs_stands_on_no_plane() -> None:
    walking = seen_by_tilted_camera(10.0)
    assert walking.root is not None
    climbing = walking.root.copy()
    climbing[40:60, 1] += 0.5  # onto something that stands in the way, and down again
    track = replace(walking, root=climbing)
    surer = tilt_evidence([walking], BODY_HEIGHT_MM).plane[1]
    assert tilt_evidence([track], BODY_HEIGHT_MM).plane[1] > 2 * surer
    assert camera_tilt_deg([track], BODY_HEIGHT_MM) == pytest.approx(10.0, abs=3.0)


def test_a_foot_that_slides_is_held_less_firmly_and_one_in_the_air_not_at_all() -> None:
    frames, rate = 40, 25.0
    feet = np.repeat(standing()[None, foot_joints(BODY)] * BODY_HEIGHT_MM, frames, axis=0)
    time_s, left = np.arange(frames) / rate, 0  # of the two feet
    still = firmness(feet, time_s)
    assert still.min() > 0.99
    sliding = feet.copy()
    sliding[:, left, 0] += 200.0 * time_s  # mm/s
    slid = firmness(sliding, time_s)
    assert 0 < slid[:, 0].max() < 0.3 and slid[:, 1].min() > 0.99
    assert contacts(sliding, time_s).all()  # slowly, which is standing still
    lifted = feet.copy()
    lifted[:, left, 1] += 150.0
    assert not firmness(lifted, time_s)[:, 0].any()
    # Seen from above, a foot that is farther away looks higher: not to who knows what is up.
    apart = feet.copy()
    apart[:, left, 2] -= 400.0
    turn = Rotation.from_euler("x", 40.0, degrees=True).as_matrix()
    assert not firmness(apart @ turn.T, time_s)[:, 0].any()
    assert firmness(apart @ turn.T, time_s, turn[:, 1]).min() > 0.99
