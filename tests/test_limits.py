"""Joint-angle limits: the learned ones, the closest valid pose, and the published ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation

from dance2pose.errors import DataError, UsageError
from dance2pose.evaluation.limits_check import score, turned
from dance2pose.limits import model as limits
from dance2pose.limits.ab15 import read_authors_limits
from dance2pose.limits.body_frames import limited_bones, parent_bone
from dance2pose.limits.learning import Margins, bin_centres, seen_directions, widen
from dance2pose.limits.model import Limits
from dance2pose.limits.projection import project_to_valid
from dance2pose.mocap.corpus import read_take
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

CMU = get("cmu17")


def wandering_poses(count: int, seed: int = 0) -> FloatArray:
    """Synthetic poses (count, 17, 3): a standing body whose bones swing by some tens of degrees."""
    rng = np.random.default_rng(seed)
    rest = {
        **dict.fromkeys(["upper_back", "head"], (0.0, 1.0, 0.0)),
        **dict.fromkeys(["left_shoulder", "left_hip"], (0.8, 0.3, 0.0)),
        **dict.fromkeys(["right_shoulder", "right_hip"], (-0.8, 0.3, 0.0)),
        **dict.fromkeys(["left_toe", "right_toe"], (0.0, -0.4, 0.9)),
    }
    out = np.zeros((count, len(CMU), 3))
    for parent, child in CMU.bones:
        direction = np.array(rest.get(CMU.joints[child], (0.0, -1.0, 0.1)))
        limited = CMU.joints[child] in limited_bones("cmu17")
        swing = rng.normal(0, 0.12 if limited else 0.03, (count, 3))
        bone = Rotation.from_rotvec(swing).apply(direction / np.linalg.norm(direction))
        out[:, child] = out[:, parent] + (100 + 10 * child) * bone
    return out


@pytest.fixture(scope="module")
def learned() -> Limits:
    return widen(seen_directions(wandering_poses(1000), "cmu17"), Margins(6.0, 12.0))


def lengths(xyz: FloatArray) -> FloatArray:
    parents, children = np.array(CMU.bones).T
    norms: FloatArray = np.linalg.norm(xyz[..., children, :] - xyz[..., parents, :], axis=-1)
    return norms


def test_poses_like_those_learned_from_are_valid_and_turned_ones_are_not(learned: Limits) -> None:
    result = score(learned, wandering_poses(400, seed=1), np.random.default_rng(2))
    assert result.valid.min() > 0.97
    assert result.refused.min() > 0.6


def test_flags_against_a_plain_reference(learned: Limits) -> None:
    """One pose at a time, with rotation matrices and no lookup shared with the code."""
    poses = wandering_poses(40, seed=3)
    for bone in limited_bones("cmu17"):
        poses = np.concatenate(
            [poses, turned(wandering_poses(15, 4), bone, "cmu17", np.random.default_rng(5))]
        )
    flags = learned.is_valid(poses)
    assert flags.mean() < 0.999
    for pose, row in zip(poses, flags, strict=True):
        for bone, expected in plain_flags(learned, pose).items():
            assert row[CMU.index(bone) - 1] == expected


def plain_flags(learned: Limits, pose: FloatArray) -> dict[str, bool]:
    out = {}
    local: dict[str, FloatArray] = {}
    frames: dict[str, FloatArray] = {}  # rows are the axes of the frame a child of the bone is in
    for number, bone in enumerate(learned.bones):
        child = CMU.index(bone)
        parent = parent_bone(bone)
        if parent is None:
            upper = bone in ("left_elbow", "right_elbow", "head")
            line = ("left_shoulder", "right_shoulder") if upper else ("left_hip", "right_hip")
            x = pose[CMU.index(line[0])] - pose[CMU.index(line[1])]
            x /= np.linalg.norm(x)
            z = np.cross(x, pose[1] - pose[0])
            z /= np.linalg.norm(z)
            frame = np.stack([x, np.cross(z, x), z])
        else:
            frame = frames[parent]
        direction = pose[child] - pose[CMU.parents[child]]
        direction = frame @ (direction / np.linalg.norm(direction))
        local[bone] = direction
        reference = learned.references[number]
        turn = Rotation.from_rotvec(
            np.cross(direction, reference)
            / np.linalg.norm(np.cross(direction, reference))
            * np.arccos(np.clip(direction @ reference, -1, 1))
        ).as_matrix()
        frames[bone] = turn @ frame
        if parent is None:
            out[bone] = bool(learned.occupancy[(number, *plain_bin(direction))])
        else:
            row = learned.region[(number - len(learned.occupancy), *plain_bin(local[parent]))]
            along = learned.axes[row] @ direction
            out[bone] = bool(((along >= learned.low[row]) & (along <= learned.high[row])).all())
    return out


def plain_bin(direction: FloatArray) -> tuple[int, int]:
    azimuth = np.degrees(np.arctan2(direction[1], direction[0])) + 180
    elevation = np.degrees(np.arcsin(direction[2])) + 90
    return min(int(azimuth // 3), 119), min(int(elevation // 3), 59)


@settings(max_examples=25, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    scale=st.floats(0.001, 100),
    shift=st.tuples(*[st.floats(-5000, 5000)] * 3),
)
def test_where_how_large_and_which_way_round_does_not_matter(
    turn: tuple[float, ...], scale: float, shift: tuple[float, ...]
) -> None:
    known = limits.load("cmu17")
    poses = wandering_poses(7, seed=6).reshape(1, 7, 17, 3)
    moved = scale * Rotation.from_rotvec(turn).apply(poses.reshape(-1, 3)) + np.array(shift)
    flags = known.is_valid(poses)
    assert flags.shape == (1, 7, 16)
    # Rounding may move a direction that lies on the edge of a bin into the next.
    assert (known.is_valid(moved.reshape(poses.shape)) == flags).mean() > 0.99


def test_left_and_right_are_judged_alike() -> None:
    known = limits.load("cmu17")
    poses = turned(wandering_poses(300, seed=7), "left_ankle", "cmu17", np.random.default_rng(8))
    image = poses[:, list(CMU.mirror)] * [-1.0, 1.0, 1.0]
    flags = known.is_valid(poses)
    swapped = known.is_valid(image)[:, [CMU.mirror[j] - 1 for j in range(1, 17)]]
    assert not flags.all()
    # The corpus was mirrored; bins are not symmetrical to the last digit.
    assert (flags == swapped).mean() > 0.97


def test_unknown_bones_are_not_refused() -> None:
    known = limits.load("cmu17")
    pose = wandering_poses(1, seed=9)
    wrong = turned(pose, "left_wrist", "cmu17", np.random.default_rng(1))
    while known.is_valid(wrong).all():
        wrong = turned(wrong, "left_wrist", "cmu17", np.random.default_rng(2))
    wrong[0, CMU.index("left_wrist")] = np.nan
    assert known.is_valid(wrong).all()
    assert known.is_valid(np.full((3, 17, 3), np.nan)).all()
    assert known.is_valid(np.zeros((3, 17, 3))).all()
    assert known.is_valid(np.empty((0, 17, 3))).shape == (0, 16)


def test_closest_valid_pose_is_valid_keeps_bones_and_leaves_valid_ones(learned: Limits) -> None:
    rng = np.random.default_rng(10)
    for bone in limited_bones("cmu17"):
        poses = turned(wandering_poses(60, seed=11), bone, "cmu17", rng)
        fixed = project_to_valid(learned, poses)
        assert learned.is_valid(fixed).all()
        np.testing.assert_allclose(lengths(fixed), lengths(poses), rtol=1e-9)
        valid = learned.is_valid(poses).all(axis=1)
        np.testing.assert_array_equal(fixed[valid], poses[valid])


@pytest.mark.parametrize("bone", ["left_elbow", "head", "right_wrist", "left_toe"])
def test_no_valid_direction_is_closer_than_the_projected_one(learned: Limits, bone: str) -> None:
    """Against trying directions all over the sphere, one bone turned, all else as it was."""
    child = CMU.index(bone)
    poses = turned(wandering_poses(12, seed=12), bone, "cmu17", np.random.default_rng(13))
    poses = poses[~learned.is_valid(poses)[:, child - 1]]
    assert len(poses) >= 4
    fixed = project_to_valid(learned, poses)
    tries = bin_centres().reshape(-1, 3)
    for pose, found in zip(poses, fixed, strict=True):
        start = pose[CMU.parents[child]]
        length = np.linalg.norm(pose[child] - start)
        many = np.repeat(pose[None], len(tries), axis=0)
        many[:, child] = start + length * tries
        cosine = (many[:, child] - start) @ (pose[child] - start) / length**2
        best = cosine[learned.is_valid(many)[:, child - 1]].max()
        ours = (found[child] - start) @ (pose[child] - start) / length**2
        assert ours > best - 1e-3


def test_closest_valid_pose_leaves_missing_joints_missing(learned: Limits) -> None:
    poses = turned(wandering_poses(7, seed=14), "left_knee", "cmu17", np.random.default_rng(15))
    poses[:, CMU.index("right_wrist")] = np.nan
    poses[3] = np.nan
    fixed = project_to_valid(learned, poses)
    np.testing.assert_array_equal(np.isnan(fixed), np.isnan(poses))
    assert learned.is_valid(fixed).all()


def test_saved_limits_read_back_the_same(learned: Limits, tmp_path: Path) -> None:
    limits.save(learned, tmp_path / "limits.npz")
    again = limits.read(tmp_path / "limits.npz")
    poses = wandering_poses(50, seed=16)
    np.testing.assert_array_equal(again.is_valid(poses), learned.is_valid(poses))
    assert again.metadata == learned.metadata


@pytest.mark.parametrize("skeleton", ["cmu17", "paper15", "body17"])
def test_limits_come_with_the_package_for_every_lifting_skeleton(skeleton: str) -> None:
    known = limits.load(skeleton)
    assert known.bones == limited_bones(skeleton)
    assert "mocap.cs.cmu.edu" in known.metadata["licence"]
    assert len(known.metadata["sources"]) == 178
    flags = known.is_valid(np.random.default_rng(0).normal(size=(200, len(get(skeleton)), 3)))
    assert 0.2 < flags.mean() < 0.9


def test_wrong_files_are_named(learned: Limits, tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(b"no archive")
    with pytest.raises(DataError, match=r"bad\.npz"):
        limits.read(path)
    np.savez(tmp_path / "other.npz", xyz=np.zeros(3))
    with pytest.raises(DataError, match=r"other.npz: lacks .*skeleton"):
        limits.read(tmp_path / "other.npz")
    np.savez(tmp_path / "pickle.npz", skeleton=np.array([{"a": 1}], dtype=object))
    with pytest.raises(DataError, match=r"pickle\.npz"):
        limits.read(tmp_path / "pickle.npz")
    cut = replace(learned, occupancy=learned.occupancy[:, :100])
    limits.save(cut, tmp_path / "cut.npz")
    with pytest.raises(DataError, match=r"cut.npz: occupancy has shape \(5, 100, 60\)"):
        limits.read(tmp_path / "cut.npz")
    astray = replace(learned, region=learned.region + len(learned.axes))
    limits.save(astray, tmp_path / "astray.npz")
    with pytest.raises(DataError, match="points outside"):
        limits.read(tmp_path / "astray.npz")


def test_wrong_use_is_refused(learned: Limits) -> None:
    with pytest.raises(UsageError, match=r"need \(\.\.\., 17, 3\)"):
        learned.is_valid(np.zeros((7, 15, 3)))
    with pytest.raises(UsageError, match="unknown skeleton"):
        limits.load("cmu18")
    with pytest.raises(UsageError, match="no bones to limit"):
        limited_bones("coco17")


@pytest.mark.shared
@pytest.mark.parametrize(
    ("file", "key"), [("jointAngleModel.mat", "valid_v1"), ("jointAngleModel_v2.mat", "valid_v2")]
)
def test_published_limits_give_every_reference_flag(shared: Path, file: str, key: str) -> None:
    published = read_authors_limits(shared / "limits" / file, shared / "limits" / "staticPose.mat")
    with np.load(shared / "limits" / "reference_flags.npz") as reference:
        flags = published.is_valid(reference["pose"])
        np.testing.assert_array_equal(flags, reference[key])
        # In any batch shape, and whichever way the body faces.
        turn = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
        turned_poses = (reference["pose"] @ turn.T).reshape(16, 86, 17, 3)
        assert (published.is_valid(turned_poses).reshape(-1, 16) == flags).mean() > 0.999


@pytest.mark.shared
def test_damaged_published_limits_are_named(shared: Path, tmp_path: Path) -> None:
    source = shared / "limits"
    with pytest.raises(DataError, match=r"staticPose.mat: lacks .*sepPlane"):
        read_authors_limits(source / "staticPose.mat", source / "staticPose.mat")
    with pytest.raises(DataError, match=r"missing\.mat"):
        read_authors_limits(tmp_path / "missing.mat", source / "staticPose.mat")
    (tmp_path / "noise.mat").write_bytes(b"\x00" * 500)
    with pytest.raises(DataError, match=r"noise\.mat"):
        read_authors_limits(tmp_path / "noise.mat", source / "staticPose.mat")
    model = loadmat(source / "jointAngleModel.mat")
    kept = {name: value for name, value in model.items() if not name.startswith("__")}
    kept["bounds"][0, 3] = np.zeros((121, 60, 4))
    savemat(tmp_path / "cut.mat", kept)
    with pytest.raises(DataError, match=r"cut.mat: bounds\{4\}"):
        read_authors_limits(tmp_path / "cut.mat", source / "staticPose.mat")


@pytest.mark.shared
def test_limits_allow_real_dance_and_refuse_turned_bones(shared: Path) -> None:
    take = read_take(shared / "mocap" / "eval" / "05_12.bvh").xyz[::8]
    result = score(limits.load("cmu17"), take, np.random.default_rng(0))
    assert result.valid.min() > 0.99
    assert result.refused.mean() > 0.5
