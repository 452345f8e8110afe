"""Limits as evidence: they mirror bones in depth where that prevails, and change nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.body import body_bones_mm, retarget
from dance2pose.limits import model as limits
from dance2pose.limits.evidence import settled
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

TREE = get("cmu17")
LIMITS = limits.load("cmu17")
TIMES = np.arange(40) / 30.0
KNEE, ANKLE, TOE = (TREE.index(f"left_{j}") for j in ("knee", "ankle", "toe"))
PARENTS, CHILDREN = np.array(TREE.bones).T


def kneeling(frames: int = 40) -> FloatArray:
    """Somebody seen from the front-left, who bends the left knee more and more: (T, J, 3) mm."""
    up, left, front = np.eye(3)[1], np.eye(3)[0], np.eye(3)[2]
    bend = np.radians(np.linspace(35, 80, frames))[:, None]
    bones = np.zeros((frames, len(TREE) - 1, 3))
    for b, joint in enumerate(TREE.joints[1:]):
        side = left if joint.startswith("left") else -left
        bones[:, b] = side if "shoulder" in joint or "hip" in joint else -up
    bones[:, [0, TREE.index("head") - 1]] = up
    bones[:, [TOE - 1, TREE.index("right_toe") - 1]] = front
    bones[:, KNEE - 1] = -up
    bones[:, ANKLE - 1] = -np.cos(bend) * up - np.sin(bend) * front
    xyz = np.zeros((frames, len(TREE), 3))
    for b, (parent, child) in enumerate(TREE.bones):
        xyz[:, child] = xyz[:, parent] + bones[:, b]
    turn = np.radians(20)
    about = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    return retarget(xyz @ about.T, TREE, body_bones_mm("cmu17"))


def mirrored(xyz: FloatArray, child: int, outwards: list[int]) -> FloatArray:
    out = xyz.copy()
    step = 2 * (xyz[:, child, 2] - xyz[:, TREE.parents[child], 2])
    out[:, outwards, 2] -= step[:, None]
    return out


def turns_deg(xyz: FloatArray) -> FloatArray:
    bone = xyz[:, CHILDREN] - xyz[:, PARENTS]
    bone /= np.linalg.norm(bone, axis=-1, keepdims=True)
    return np.degrees(np.arccos(np.clip((bone[1:] * bone[:-1]).sum(axis=-1), -1, 1)))


def unsure(xyz: FloatArray, odds: float = 0.3) -> FloatArray:
    return np.full((len(xyz), len(TREE) - 1), odds)


def test_a_knee_bent_the_wrong_way_is_mirrored_back() -> None:
    truth = kneeling()
    assert LIMITS.is_valid(truth)[:, ANKLE - 1].all()
    wrong = mirrored(truth, ANKLE, [ANKLE, TOE])
    assert LIMITS.verdict(wrong).refused[:, ANKLE - 1].mean() > 0.5
    np.testing.assert_allclose(settled(LIMITS, wrong, unsure(wrong), TIMES), truth, atol=1e-9)


def test_what_is_known_better_than_the_limits_stays() -> None:
    wrong = mirrored(kneeling(), ANKLE, [ANKLE, TOE])
    np.testing.assert_array_equal(settled(LIMITS, wrong, unsure(wrong, 20.0), TIMES), wrong)


def test_poses_within_limits_stay() -> None:
    truth = kneeling()
    np.testing.assert_array_equal(settled(LIMITS, truth, unsure(truth, 0.0), TIMES), truth)


@pytest.mark.parametrize("seed", range(8))
def test_the_picture_and_the_lengths_stay_and_nothing_jumps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(len(TREE) - 1, 3))
    drift = np.cumsum(rng.normal(0, 0.12, (40, len(TREE) - 1, 3)), axis=0)
    xyz = np.zeros((40, len(TREE), 3))
    for b, (parent, child) in enumerate(TREE.bones):
        xyz[:, child] = xyz[:, parent] + direction[b] + drift[:, b]
    xyz = retarget(xyz, TREE, body_bones_mm("cmu17"))
    out = settled(LIMITS, xyz, unsure(xyz, 0.0), TIMES)
    assert (out != xyz).any()
    np.testing.assert_array_equal(out[..., :2], xyz[..., :2])
    lengths = np.linalg.norm(out[:, CHILDREN] - out[:, PARENTS], axis=-1)
    np.testing.assert_allclose(lengths, np.tile(body_bones_mm("cmu17"), (40, 1)), rtol=1e-9)
    assert (turns_deg(out) <= np.maximum(turns_deg(xyz), 40.0) + 1e-6).all()


def test_a_few_frames_alone_are_not_mirrored_out_of_a_motion() -> None:
    # The elbow at 40 degrees in front of the body: frames amid a motion in which the bone never
    # crosses the picture's plane stand or fall with all others.
    truth = kneeling()
    wrong = truth.copy()
    wrong[15:18] = mirrored(truth, ANKLE, [ANKLE, TOE])[15:18]
    out = settled(LIMITS, wrong, unsure(wrong, 0.0), TIMES)
    assert turns_deg(out).max() <= max(turns_deg(wrong).max(), 40.0)


def test_unrelated_pictures_are_judged_one_by_one() -> None:
    truth = kneeling(7)
    wrong = truth.copy()
    wrong[::2] = mirrored(truth, ANKLE, [ANKLE, TOE])[::2]
    apart = 1e3 * np.arange(7)
    together = settled(LIMITS, wrong, unsure(wrong), apart)
    alone = np.concatenate(
        [settled(LIMITS, wrong[i : i + 1], unsure(wrong[i : i + 1]), apart[:1]) for i in range(7)]
    )
    np.testing.assert_allclose(together, alone)


def test_poses_of_nothing_known_stay_unknown() -> None:
    nothing = np.full((5, len(TREE), 3), np.nan)
    out = settled(LIMITS, nothing, unsure(nothing), TIMES[:5])
    assert np.isnan(out).all()


def test_limits_say_whether_many_takes_refuse_a_bone_or_none_was_seen() -> None:
    rng = np.random.default_rng(3)
    xyz = np.cumsum(rng.normal(size=(400, len(TREE), 3)), axis=1)
    verdict = LIMITS.verdict(xyz)
    np.testing.assert_array_equal(verdict.valid, LIMITS.is_valid(xyz))
    assert verdict.refused.any() and (~verdict.valid & ~verdict.refused).any()
    assert not (verdict.refused & verdict.valid).any()
    unlimited = [b for b in range(len(TREE) - 1) if TREE.joints[b + 1] not in LIMITS.bones]
    assert (verdict.takes[:, unlimited] == 0).all()
