"""Layouts are named, not guessed in silence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose import skeleton
from dance2pose.errors import DataError, UsageError
from dance2pose.lifting import lift
from dance2pose.reading import ReadTracks, read_tracks
from dance2pose.reading.joint_names import best_skeleton, meaning
from dance2pose.reading.layouts import edge_length
from dance2pose.skeleton import SKELETONS_BY_COUNT
from reading_making import HEIGHT, MADE, RATE, WIDTH, body, results, scene

KEYPOINTS = [name for names in SKELETONS_BY_COUNT.values() for name in names]


def _read(folder: Path, name: str, **options: str) -> ReadTracks:
    path = results(folder, scene(name, people=1))
    return read_tracks(path, frame_rate=RATE, image_size=(WIDTH, HEIGHT), **options)


@pytest.mark.parametrize("count", SKELETONS_BY_COUNT)
def test_the_number_of_keypoints_is_said_with_what_it_is_read_as(
    tmp_path: Path, count: int
) -> None:
    first, *others = SKELETONS_BY_COUNT[count]
    assert all(len(skeleton.get(name)) == count for name in (first, *others))
    found = _read(tmp_path, first)
    assert found.tracks[0].skeleton == first
    (said,) = [note for note in found.notes if "keypoints read as" in note]
    assert said.startswith(f"{count} keypoints read as {first}")
    assert all(other in said for other in others)


@pytest.mark.parametrize("name", KEYPOINTS)
def test_a_named_skeleton_decides_and_none_is_implausible(tmp_path: Path, name: str) -> None:
    found = _read(tmp_path, name, skeleton=name)
    assert found.tracks[0].skeleton == name
    assert not any("implausible" in note for note in found.notes)


@pytest.mark.parametrize(
    ("real", "assumed"), [("body25b", "body25"), ("h36m17", "coco17"), ("coco17", "h36m17")]
)
def test_bones_that_are_implausible_are_said_with_what_fits(
    tmp_path: Path, real: str, assumed: str
) -> None:
    found = _read(tmp_path, real, skeleton=assumed)
    assert found.tracks[0].skeleton == assumed
    (said,) = [note for note in found.notes if "implausible" in note]
    assert said.endswith(f"is it --skeleton {real}?")


def test_keypoints_in_no_known_order_are_doubted(tmp_path: Path) -> None:
    frames = scene("halpe26", people=1)
    order = np.random.default_rng(3).permutation(26)
    for (person,) in frames.values():
        person.keypoints[:] = person.keypoints[order]
    found = read_tracks(results(tmp_path, frames), frame_rate=RATE)
    assert any("in another order?" in note for note in found.notes)


@settings(deadline=None)
@given(name=st.sampled_from(KEYPOINTS), frame=st.integers(0, 90), gone=st.integers(0, 15))
def test_edges_of_the_right_layout_are_short(name: str, frame: int, gone: int) -> None:
    points = body(name, frame=frame, left=50)[np.newaxis, :, :2]
    points[0, gone] = np.nan
    assert edge_length(points, skeleton.get(name)) < 0.25


def test_hands_of_a_whole_body_are_kept_and_its_body_lifted(tmp_path: Path) -> None:
    (track,) = _read(tmp_path, "wholebody133").tracks
    whole = skeleton.get("wholebody133")
    hand = [n for n, joint in enumerate(whole.joints) if "finger" in joint]
    assert len(hand) == 32
    planted = scene("wholebody133", people=1)
    np.testing.assert_allclose(track.xy[0, hand], planted[3][0].keypoints[hand, :2], atol=1e-3)
    poses = lift(track, camera="weak-perspective")
    assert poses.skeleton == "body17"
    assert np.isfinite(poses.xyz).all()


def test_an_unknown_skeleton_or_number_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"unknown skeleton 'kinect25'; known: .*wholebody133"):
        _read(tmp_path, "coco17", skeleton="kinect25")
    with pytest.raises(DataError, match=r"has 17 keypoints, expected 25 \(body25\)"):
        _read(tmp_path, "coco17", skeleton="body25")
    frames = scene("coco17", people=1)
    path = results(tmp_path, frames)
    content = json.loads(path.read_text())
    for one in content:
        one["keypoints"] = one["keypoints"][: 3 * 14]
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"has 14 keypoints; known numbers: 16 \(mpii16\), 17"):
        read_tracks(path, frame_rate=RATE)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("LKnee", "leftknee"),
        ("knee_l", "leftknee"),
        ("Left Knee", "leftknee"),
        ("leftKnee", "leftknee"),
        ("left_knee", "leftknee"),
        ("LEFT_KNEE", "leftknee"),
        ("lknee", "leftknee"),
        ("knee2", "leftknee"),
        ("knee1", "rightknee"),
        ("R.Shoulder", "rightshoulder"),
        ("Hip", "pelvis"),
        ("MidHip", "pelvis"),
        ("RBigToe", "rightbigtoe"),
        ("Nose", "nose"),
        ("tail", "tail"),
        ("lips", "lips"),
    ],
)
def test_names_of_joints_in_the_habits_of_tools(name: str, meant: str) -> None:
    assert meaning(name) == meant


@settings(deadline=None)
@given(st.sampled_from(KEYPOINTS), st.randoms(use_true_random=False))
def test_a_skeleton_is_known_by_its_names_in_any_order(name: str, random: object) -> None:
    joints = list(skeleton.get(name).joints)
    random.shuffle(joints)  # type: ignore[attr-defined]
    found, columns = best_skeleton(joints, skeleton.names())
    assert found == name
    assert [joints[columns[j]] for j in range(len(joints))] == list(skeleton.get(name).joints)


def test_names_of_a_mouse_are_no_body(tmp_path: Path) -> None:
    path = MADE["sleap csv"].write(tmp_path, scene("coco17", people=1))
    text = path.read_text()
    for n, joint in enumerate(skeleton.get("coco17").joints):
        text = text.replace(joint, f"whisker_{n}_of_mouse")
    path.write_text(text)
    with pytest.raises(DataError, match="are not those of a body that is known"):
        read_tracks(path, frame_rate=RATE)


def test_body_parts_that_the_skeleton_lacks_are_left_out_and_said(tmp_path: Path) -> None:
    path = MADE["sleap csv"].write(tmp_path, scene("coco17", people=1))
    path.write_text(path.read_text().replace("right_ear", "fan"))
    found = read_tracks(path, frame_rate=RATE)
    assert "16 of 17 named keypoints read as coco17 (left out: fan)" in found.notes
    assert np.isnan(found.tracks[0].xy[:, skeleton.get("coco17").index("right_ear")]).all()
