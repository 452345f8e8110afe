"""Joint angles against planted turns of an independent body, and what they must not depend on."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dance2pose.angles import (
    angle_names,
    joint_angles,
    pelvis_rotation,
    track_angles,
)
from dance2pose.errors import UsageError
from dance2pose.poses import Track3D
from dance2pose.skeleton import get
from export_making import make_poses, planted_places

JOINTS = get("body17").joints
# A body that faces +x, y up, its right at +z, as biomechanics has it: no part of the package.
FORWARD, UP, RIGHT = np.eye(3)


def body(
    *,
    side: str = "right",
    hip: tuple[float, float, float] = (0, 0, 0),
    knee: float = 0,
    shoulder: tuple[float, float, float] = (0, 0, 0),
    elbow: float = 0,
    ankle: float = 0,
) -> np.ndarray:
    """Joints of a body (J, 3) with given flexion, adduction and internal rotation, in degrees.

    Built by turning rigid limbs as Grood and Suntay's joint has it: flexion about the body's
    right, adduction about forward, rotation about the limb, each in the axes left by the last.
    """
    sign = 1 if side == "right" else -1
    at = {name: np.full(3, np.nan) for name in JOINTS}
    at["pelvis"], at["neck"] = np.zeros(3), 0.5 * UP
    at["head"] = 0.7 * UP
    for s, d in (("left", -1), ("right", 1)):
        at[f"{s}_hip"], at[f"{s}_shoulder"] = 0.1 * d * RIGHT, 0.5 * UP + 0.18 * d * RIGHT

    def limb(angles: tuple[float, float, float]) -> Rotation:
        flexion, adduction, rotation = np.radians(angles)
        # About forward, +x, a positive turn takes down (-y) to -z: to the body's left.
        return Rotation.from_euler("ZXY", [flexion, sign * adduction, sign * rotation])

    thigh = limb(hip)
    at[f"{side}_knee"] = at[f"{side}_hip"] + thigh.apply(-0.4 * UP)
    shin = thigh * Rotation.from_euler("z", -knee, degrees=True)
    at[f"{side}_ankle"] = at[f"{side}_knee"] + shin.apply(-0.4 * UP)
    foot = shin * Rotation.from_euler("z", ankle, degrees=True)
    at[f"{side}_toe"] = at[f"{side}_ankle"] + foot.apply(0.2 * FORWARD)
    arm = limb(shoulder)
    at[f"{side}_elbow"] = at[f"{side}_shoulder"] + arm.apply(-0.3 * UP)
    fore = arm * Rotation.from_euler("z", elbow, degrees=True)
    at[f"{side}_wrist"] = at[f"{side}_elbow"] + fore.apply(-0.25 * UP)
    return np.array([at[name] for name in JOINTS])


def track_of(xyz: np.ndarray, sigma: float | None = None) -> Track3D:
    poses = make_poses(np.arange(len(xyz)) / 25, rooted=False)
    spread = None if sigma is None else np.full(xyz.shape[:2], sigma)
    return dataclasses.replace(poses, xyz=xyz, sigma=spread)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("hip", [(0, 0, 0), (70, -20, 25), (-25, 10, -30), (150, -35, 10)])
@pytest.mark.parametrize("shoulder", [(0, 0, 0), (95, -40, 35), (-30, 5, -20), (170, -60, 15)])
def test_turns_of_planted_limbs_are_found_with_their_signs(
    side: str, hip: tuple[float, float, float], shoulder: tuple[float, float, float]
) -> None:
    angles = joint_angles(
        body(side=side, hip=hip, knee=60, shoulder=shoulder, elbow=80, ankle=15), "body17"
    )
    found = {name.removeprefix(f"{side}_"): a for name, a in angles.items() if side in name}
    assert found["hip_flexion"] == pytest.approx(hip[0])
    assert found["hip_abduction"] == pytest.approx(-hip[1])
    assert found["hip_rotation"] == pytest.approx(hip[2])
    assert found["knee_flexion"] == pytest.approx(60)
    assert found["ankle_flexion"] == pytest.approx(15)
    assert found["shoulder_flexion"] == pytest.approx(shoulder[0])
    assert found["shoulder_abduction"] == pytest.approx(-shoulder[1])
    assert found["shoulder_rotation"] == pytest.approx(shoulder[2])
    assert found["elbow_flexion"] == pytest.approx(80)
    down = np.degrees(np.arccos(np.cos(np.radians(shoulder[0])) * np.cos(np.radians(shoulder[1]))))
    assert found["shoulder_elevation"] == pytest.approx(down)


@pytest.mark.parametrize("bend", [0.0, 20.0, 165.0])
def test_rotation_is_not_claimed_where_no_bend_shows_it(bend: float) -> None:
    angles = joint_angles(body(hip=(30, 0, 40), knee=bend, elbow=bend), "body17")
    assert np.isnan(angles["right_hip_rotation"]) and np.isnan(angles["right_shoulder_rotation"])
    assert angles["right_hip_flexion"] == pytest.approx(30)


def test_flexion_is_left_out_next_to_its_pole_and_abduction_is_not() -> None:
    for abduction in (-85, 85):
        angles = joint_angles(body(hip=(50, -abduction, 0)), "body17")
        assert np.isnan(angles["right_hip_flexion"])
        assert angles["right_hip_abduction"] == pytest.approx(abduction)


@pytest.mark.parametrize("turned", [0.0, 130.0])
@pytest.mark.parametrize("forward", [0.0, 35.0, -20.0])
def test_lean_is_against_the_vertical_whichever_way_the_dancer_faces(
    turned: float, forward: float
) -> None:
    about = Rotation.from_euler("y", turned, degrees=True)
    bent = Rotation.from_euler("z", -forward, degrees=True)
    angles = joint_angles(about.apply(bent.apply(body())), "body17")
    assert angles["trunk_lean"] == pytest.approx(abs(forward), abs=1e-6)
    assert angles["trunk_lean_forward"] == pytest.approx(forward)
    assert angles["trunk_lean_right"] == pytest.approx(0, abs=1e-6)
    tilted = about.apply(Rotation.from_euler("x", 25, degrees=True).apply(body()))
    assert joint_angles(tilted, "body17")["trunk_lean_right"] == pytest.approx(25)


def test_trunk_turns_to_the_left_positive() -> None:
    xyz = body()
    shoulders = [JOINTS.index("left_shoulder"), JOINTS.index("right_shoulder")]
    xyz[shoulders] = Rotation.from_euler("y", 30, degrees=True).apply(xyz[shoulders])
    assert joint_angles(xyz, "body17")["trunk_rotation"] == pytest.approx(30)


def test_pelvis_turns_as_opensim_has_them() -> None:
    tilt, pelvic_list, rotation = -20.0, 8.0, 140.0
    turn = Rotation.from_euler("ZXY", [tilt, pelvic_list, rotation], degrees=True)
    found = pelvis_rotation(track_of(turn.apply(body())[None]))
    np.testing.assert_allclose(found, [[tilt, pelvic_list, rotation]], atol=1e-9)


def test_a_whole_turn_does_not_jump_and_a_gap_starts_afresh() -> None:
    flexion = np.linspace(0, 400, 81)  # a propeller
    xyz = np.array([body(shoulder=(f, 0, 0)) for f in flexion])
    curve = track_angles(track_of(xyz))["right_shoulder_flexion"].degrees
    np.testing.assert_allclose(curve, flexion, atol=1e-6)
    xyz[60:63] = np.nan
    broken = track_angles(track_of(xyz))["right_shoulder_flexion"].degrees
    np.testing.assert_allclose(broken[:60], flexion[:60], atol=1e-6)
    np.testing.assert_allclose(broken[63:], flexion[63:] - 360, atol=1e-6)


def test_uncertainty_is_that_of_noise_of_the_same_size() -> None:
    sigma, rng = 0.004, np.random.default_rng(0)
    xyz = body(hip=(50, -20, 10), knee=70, shoulder=(60, -30, 20), elbow=80, ankle=10)
    noisy = xyz + rng.normal(0, sigma, (4000, *xyz.shape))
    said = track_angles(track_of(xyz[None], sigma))
    for name, angle in joint_angles(noisy, "body17").items():
        if name.startswith("left") or name.startswith("trunk_lean"):
            continue
        curve = said[name]
        assert curve.sigma_deg is not None
        assert curve.sigma_deg[0] == pytest.approx(np.nanstd(angle), rel=0.06), name


def test_without_sigma_no_uncertainty_is_claimed() -> None:
    assert all(c.sigma_deg is None for c in track_angles(track_of(body()[None])).values())


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100), st.floats(-180, 180))
def test_does_not_depend_on_place_heading_and_size(seed: int, scale: float, turn: float) -> None:
    xyz = planted_places(np.linspace(0, 1, 5), seed=seed)
    about = Rotation.from_euler("y", turn, degrees=True)
    moved = scale * about.apply(xyz.reshape(-1, 3)).reshape(xyz.shape) + 5
    before, after = joint_angles(xyz, "body17"), joint_angles(moved, "body17")
    for name in before:
        apart = (after[name] - before[name] + 180) % 360 - 180
        np.testing.assert_allclose(apart, 0 * before[name], atol=1e-4)


def test_left_and_right_change_places_in_the_mirror() -> None:
    skeleton = get("body17")
    xyz = planted_places(np.linspace(0, 1, 7), seed=1)
    mirrored = (xyz * [-1, 1, 1])[:, list(skeleton.mirror)]
    before, after = joint_angles(xyz, "body17"), joint_angles(mirrored, "body17")
    for name in before:
        if name.startswith("left_"):
            np.testing.assert_allclose(after[name], before[f"right{name[4:]}"])
    np.testing.assert_allclose(after["trunk_rotation"], -before["trunk_rotation"])
    np.testing.assert_allclose(after["trunk_lean_right"], -before["trunk_lean_right"])


def test_stays_exact_where_the_limb_is_straight() -> None:
    xyz = np.zeros((len(JOINTS), 3))
    xyz[JOINTS.index("left_shoulder")] = [1.0, 0, 0]
    for turn in (1e-7, 1e-5, 1e-3):
        xyz[JOINTS.index("left_wrist")] = [-np.cos(turn), np.sin(turn), 0]
        flexion = joint_angles(xyz, "body17")["left_elbow_flexion"]
        assert np.radians(flexion) == pytest.approx(turn, rel=1e-6)


def test_what_is_missing_is_nan() -> None:
    xyz = planted_places(np.linspace(0, 1, 7), seed=2)
    xyz[2, JOINTS.index("left_wrist")] = np.nan
    xyz[4, JOINTS.index("left_wrist")] = xyz[4, JOINTS.index("left_elbow")]
    elbow = joint_angles(xyz, "body17")["left_elbow_flexion"]
    np.testing.assert_array_equal(np.isnan(elbow), np.isin(np.arange(7), (2, 4)))


def test_other_skeletons_give_what_they_have() -> None:
    names = angle_names("body17")
    assert set(angle_names("cmu17")) == set(names)
    assert set(names) - set(angle_names("paper15")) == {
        "left_ankle_flexion",
        "right_ankle_flexion",
    }


def test_refuses_the_wrong_number_of_joints_and_unknown_skeletons() -> None:
    with pytest.raises(ValueError, match=r"\(7, 15, 3\).*17"):
        joint_angles(np.zeros((7, 15, 3)), "body17")
    with pytest.raises(UsageError, match="nobody"):
        joint_angles(np.zeros((7, 15, 3)), "nobody")
