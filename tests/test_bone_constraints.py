"""Poses get the bones that they should have, near where they were."""

from __future__ import annotations

import numpy as np

from dance2pose.body import body_bones_mm, retarget
from dance2pose.lifting.temporal.bone_constraints import with_bone_lengths
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

TREE = get("cmu17")
USUAL = body_bones_mm("cmu17")
PARENTS, CHILDREN = np.array(TREE.bones).T


def poses(frames: int, seed: int) -> FloatArray:
    return retarget(
        np.cumsum(np.random.default_rng(seed).normal(size=(frames, len(TREE), 3)), axis=1),
        TREE,
        USUAL,
    )


def lengths_of(xyz: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(xyz[:, CHILDREN] - xyz[:, PARENTS], axis=-1))


def test_bones_get_their_lengths_and_poses_that_have_them_stay() -> None:
    xyz = poses(7, 1)
    variance = np.full(xyz.shape, 400.0)
    np.testing.assert_allclose(with_bone_lengths(xyz, variance, TREE, USUAL), xyz, atol=1e-6)
    found = with_bone_lengths(1.1 * xyz, variance, TREE, USUAL, spread=1e-4)
    np.testing.assert_allclose(lengths_of(found), np.tile(USUAL, (7, 1)), rtol=0.01)
    assert np.linalg.norm(found - 1.1 * xyz, axis=-1).max() < 200


def test_depths_that_may_change_do_and_the_picture_that_may_not_does_not() -> None:
    xyz = poses(7, 2)
    flattened = xyz * [1.0, 1.0, 0.9]
    variance = np.full(xyz.shape, [1e-2, 1e-2, 400.0])
    found = with_bone_lengths(flattened, variance, TREE, USUAL, spread=1e-3)
    assert np.abs(found[..., :2] - xyz[..., :2]).max() < 2
    before = np.abs(lengths_of(flattened) - USUAL).mean()
    assert np.abs(lengths_of(found) - USUAL).mean() < 0.3 * before


def test_every_one_of_many_pictures_has_a_body_of_its_own() -> None:
    xyz = poses(1100, 3)
    factor = np.random.default_rng(4).uniform(0.9, 1.1, (1100, 1))
    wanted = USUAL * factor
    found = with_bone_lengths(
        xyz, np.full(xyz.shape, 400.0), TREE, wanted, spread=np.full(wanted.shape, 1e-4)
    )
    assert np.quantile(np.abs(lengths_of(found) / wanted - 1), 0.99) < 0.01


def densely(
    xyz: FloatArray, variance: FloatArray, wanted: FloatArray, spread: FloatArray
) -> FloatArray:
    """What `with_bone_lengths` minimises, for one pose, with whole matrices."""
    now = xyz
    for _ in range(5):
        bone = now[CHILDREN] - now[PARENTS]
        direction = bone / np.linalg.norm(bone, axis=-1, keepdims=True)
        slope = np.zeros((len(wanted), *xyz.shape))
        slope[np.arange(len(wanted)), CHILDREN] = direction
        slope[np.arange(len(wanted)), PARENTS] = -direction
        slope = slope.reshape(len(wanted), -1)
        normal = (slope * variance.ravel()) @ slope.T + np.diag((spread * wanted) ** 2 + 1.0)
        force = np.linalg.solve(normal, slope @ xyz.ravel() - wanted)
        now = xyz - (variance.ravel() * (force @ slope)).reshape(xyz.shape)
    return now


def test_joint_by_joint_along_the_tree_is_the_same_as_all_at_once() -> None:
    rng = np.random.default_rng(5)
    xyz = poses(7, 6) + rng.normal(0, 30, (7, len(TREE), 3))
    variance, spread = rng.uniform(1, 2000, xyz.shape), rng.uniform(0.003, 0.05, len(USUAL))
    found = with_bone_lengths(xyz, variance, TREE, USUAL, spread=spread)
    for pose, given, giving in zip(found, xyz, variance, strict=True):
        np.testing.assert_allclose(pose, densely(given, giving, USUAL, spread), atol=1e-7)
