"""Limbs: straight ones stay straight through errors, bent ones stay bent."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal.body_of_track import Joints
from dance2pose.lifting.temporal.limbs import straightened
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

TREE = get("body17")
LEG = [TREE.index(f"left_{joint}") for joint in ("hip", "knee", "ankle")]


def legs(flexion_deg: float, frames: int, seed: int, error_mm: float) -> FloatArray:
    """Poses (N, J, 3) with a left leg of that flexion about any axis, joints off by an error."""
    rng = np.random.default_rng(seed)
    lengths = body_bones_mm("body17")[[LEG[1] - 1, LEG[2] - 1]]
    axis = rng.normal(size=(frames, 3))
    axis[:, 1] = 0
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.radians(flexion_deg)
    xyz = np.zeros((frames, len(TREE), 3))
    down = np.array([0.0, -1.0, 0.0])
    xyz[:, LEG[1]] = lengths[0] * down
    shin = np.cos(angle) * down + np.sin(angle) * np.cross(axis, down)
    xyz[:, LEG[2]] = xyz[:, LEG[1]] + lengths[1] * shin
    return xyz + rng.normal(0, error_mm, xyz.shape)


def straight(xyz: FloatArray, sigma: FloatArray) -> FloatArray:
    """Frames so far apart that none tells of another."""
    times = 10.0 * np.arange(len(xyz))
    return straightened(Joints(xyz, sigma), TREE, times, [np.arange(len(xyz))]).xyz


def flexion(xyz: FloatArray) -> FloatArray:
    upper, lower = xyz[:, LEG[1]] - xyz[:, LEG[0]], xyz[:, LEG[2]] - xyz[:, LEG[1]]
    cross = np.linalg.norm(np.cross(upper, lower), axis=1)
    return np.degrees(np.arctan2(cross, (upper * lower).sum(axis=1)))


def test_a_straight_leg_seen_with_errors_is_straight() -> None:
    xyz = legs(0.0, 500, 1, 25.0)
    found = straight(xyz, np.full(xyz.shape, 25.0))
    assert flexion(xyz).mean() > 7
    assert np.median(flexion(found)) < 1
    assert flexion(found).mean() < 0.5 * flexion(xyz).mean()


@pytest.mark.parametrize("flexion_deg", [30.0, 60.0, 110.0])
def test_a_bent_leg_stays_bent(flexion_deg: float) -> None:
    xyz = legs(flexion_deg, 300, 2, 15.0)
    found = straight(xyz, np.full(xyz.shape, 15.0))
    assert abs(flexion(found).mean() - flexion_deg) < 3


def test_a_limb_plainly_bent_is_never_taken_for_straight() -> None:
    xyz = legs(45.0, 9, 7, 0.0)
    np.testing.assert_allclose(straight(xyz, np.full(xyz.shape, 55.0)), xyz, atol=1e-9)
    less = flexion(straight(legs(30.0, 9, 7, 0.0), np.full(xyz.shape, 55.0)))
    assert (less < 25).all()


def test_the_surer_the_joints_the_less_is_taken_back() -> None:
    xyz = legs(15.0, 50, 3, 0.0)
    taken = [np.abs(straight(xyz, np.full(xyz.shape, s)) - xyz).max() for s in (1.0, 10.0, 50.0)]
    assert taken[0] < 0.1 < taken[1] < taken[2]


def test_errors_of_the_picture_say_nothing_of_a_bend_in_depth() -> None:
    xyz = np.zeros((1, len(TREE), 3))
    xyz[0, LEG[1]], xyz[0, LEG[2]] = [0.0, -400.0, 60.0], [0.0, -800.0, 0.0]
    sigma = np.full(xyz.shape, [60.0, 60.0, 5.0])
    in_depth = straight(xyz, sigma)
    in_picture = straight(xyz[..., [2, 1, 0]], sigma)
    assert in_depth[0, LEG[1], 2] > 58
    assert abs(in_picture[0, LEG[1], 0]) < 1


def test_only_elbows_and_knees_move() -> None:
    rng = np.random.default_rng(4)
    down = np.arange(len(TREE))[:, None] * [0.0, -200.0, 0.0]
    xyz = down + rng.normal(0, 10, (9, len(TREE), 3))
    found = straight(xyz, np.full(xyz.shape, 200.0))
    moved = {TREE.joints[j] for j in np.flatnonzero((found != xyz).any(axis=(0, 2)))}
    assert moved == {"left_elbow", "right_elbow", "left_knee", "right_knee"}


def test_one_frame_alone_is_not_straightened_amid_bent_ones() -> None:
    xyz = legs(50.0, 60, 5, 0.0)
    xyz[:] = xyz[0]
    xyz[30, LEG[1]] = (xyz[30, LEG[0]] + xyz[30, LEG[2]]) / 2 + [0.0, 0.0, 30.0]
    joints = Joints(xyz, np.full(xyz.shape, 30.0))
    times = np.arange(60) / 30.0
    found = straightened(joints, TREE, times, [np.arange(60)]).xyz
    assert np.abs(found[30] - xyz[30]).max() < 10


def test_where_nothing_is_known_bends_stay() -> None:
    xyz = legs(70.0, 9, 6, 0.0)
    found = straight(xyz, np.full(xyz.shape, 400.0))
    assert (flexion(found) > 55).all()
