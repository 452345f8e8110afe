"""Joint angles against known poses, an independent formula, and what they must not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dance2pose.angles import ANGLE_JOINTS, angle_at, joint_angles
from dance2pose.errors import UsageError
from dance2pose.skeleton import get

JOINTS = get("body17").joints


def pose(**places: tuple[float, float, float]) -> np.ndarray:
    xyz = np.full((len(JOINTS), 3), np.nan)
    for name, place in places.items():
        xyz[JOINTS.index(name)] = place
    return xyz


def test_known_poses() -> None:
    xyz = pose(
        left_shoulder=(0.2, 1.4, 0),
        left_elbow=(0.5, 1.4, 0),
        left_wrist=(0.5, 1.7, 0),
        left_hip=(0.2, 0.9, 0),
        left_knee=(0.2, 0.5, 0),
        left_ankle=(0.2, 0.1, 0),
    )
    angles = joint_angles(xyz, "body17")
    assert angles["left_elbow"] == pytest.approx(90)
    assert angles["left_shoulder"] == pytest.approx(90)
    assert angles["left_hip"] == pytest.approx(180)
    assert angles["left_knee"] == pytest.approx(180)
    assert all(np.isnan(angles[name]) for name in ANGLE_JOINTS if name.startswith("right"))


def test_agrees_with_the_arccosine_frame_by_frame() -> None:
    xyz = np.random.default_rng(0).normal(size=(7, len(JOINTS), 3))
    angles = joint_angles(xyz, "body17")
    assert set(angles) == set(ANGLE_JOINTS)
    names = {name: i for i, name in enumerate(JOINTS)}
    for side in ("left", "right"):
        for t in range(7):
            knee = xyz[t, names[f"{side}_knee"]]
            thigh = xyz[t, names[f"{side}_hip"]] - knee
            shin = xyz[t, names[f"{side}_ankle"]] - knee
            cosine = thigh @ shin / np.linalg.norm(thigh) / np.linalg.norm(shin)
            assert angles[f"{side}_knee"][t] == pytest.approx(np.degrees(np.arccos(cosine)))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 100))
def test_does_not_depend_on_place_direction_and_size(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(3, len(JOINTS), 3))
    moved = scale * Rotation.random(rng=rng).apply(xyz.reshape(-1, 3)).reshape(xyz.shape) + 5
    before, after = joint_angles(xyz, "body17"), joint_angles(moved, "body17")
    for name in ANGLE_JOINTS:
        np.testing.assert_allclose(after[name], before[name], atol=1e-4)


def test_left_and_right_change_places_in_the_mirror() -> None:
    skeleton = get("body17")
    xyz = np.random.default_rng(1).normal(size=(7, len(skeleton), 3))
    mirrored = (xyz * [-1, 1, 1])[:, list(skeleton.mirror)]
    before, after = joint_angles(xyz, "body17"), joint_angles(mirrored, "body17")
    np.testing.assert_allclose(after["left_elbow"], before["right_elbow"])
    np.testing.assert_allclose(after["right_hip"], before["left_hip"])


def test_stays_exact_where_the_limb_is_straight() -> None:
    vertex, first = np.zeros(3), np.array([1.0, 0, 0])
    for turn in (1e-7, 1e-5, 1e-3):
        second = np.array([-np.cos(turn), np.sin(turn), 0])
        angle = angle_at(vertex, first, second)
        assert np.radians(180 - angle) == pytest.approx(turn, rel=1e-6)


def test_what_is_missing_is_nan() -> None:
    xyz = np.random.default_rng(2).normal(size=(7, len(JOINTS), 3))
    xyz[2, JOINTS.index("left_wrist")] = np.nan
    xyz[4, JOINTS.index("left_wrist")] = xyz[4, JOINTS.index("left_elbow")]
    elbow = joint_angles(xyz, "body17")["left_elbow"]
    np.testing.assert_array_equal(np.isnan(elbow), np.isin(np.arange(7), (2, 4)))


def test_refuses_the_wrong_number_of_joints_and_unknown_skeletons() -> None:
    with pytest.raises(ValueError, match=r"\(7, 15, 3\).*17"):
        joint_angles(np.zeros((7, 15, 3)), "body17")
    with pytest.raises(UsageError, match="nobody"):
        joint_angles(np.zeros((7, 15, 3)), "nobody")
