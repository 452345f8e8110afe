"""Keypoints of other programs become tracks; what is wrong with a file is said by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dance2pose import skeleton
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import write_track
from dance2pose.pose_files import read_tracks

FRAMES = 9


def _person(frame: int, joints: int, *, left: float) -> np.ndarray:
    """Synthetic: a cloud of keypoints that walks to the right. (J, 3)."""
    shape = np.random.default_rng(joints).uniform(-1, 1, (joints, 2)) * (20, 60)
    xy = shape + np.array([left + 3 * frame, 150])
    return np.column_stack([xy, np.linspace(0.5, 0.9, joints)]).round(3)


def _write_openpose(folder: Path, *, frames: int = FRAMES, joints: int = 25) -> None:
    folder.mkdir(exist_ok=True)
    for frame in range(frames):
        people = [_person(frame, joints, left=left) for left in (100, 400)]
        if frame % 2:
            people.reverse()  # OpenPose gives people in no order
        people[0][7] = 0  # not found: OpenPose writes zeros
        content = {
            "version": 1.3,
            "people": [
                {"person_id": [-1], "pose_keypoints_2d": p.ravel().tolist()} for p in people
            ],
        }
        name = folder / f"take2_{frame + 40:012d}_keypoints.json"
        name.write_text(json.dumps(content))


def test_an_openpose_folder_gives_one_track_a_dancer(tmp_path: Path) -> None:
    _write_openpose(tmp_path / "json")
    tracks = read_tracks(tmp_path / "json", frame_rate=25, image_size=(640, 360))
    assert [track.person for track in tracks] == [1, 2]
    for track in tracks:
        left = 400 if track.xy[0, 0, 0] > 250 else 100
        np.testing.assert_array_equal(track.frame, np.arange(40, 40 + FRAMES))
        np.testing.assert_allclose(track.time_s, track.frame / 25)
        assert (track.skeleton, track.image_size) == ("body25", (640, 360))
        for row in range(FRAMES):
            expected = _person(row, 25, left=left)
            joints = [j for j in range(25) if j != 7]
            np.testing.assert_allclose(track.xy[row, joints], expected[joints, :2], atol=1e-3)
            np.testing.assert_allclose(track.confidence[row, joints], expected[joints, 2])
    # The zeros were missing keypoints. They were interpolated between their neighbours, or, at
    # an end of the track, are missing; nowhere are they a keypoint at the corner of the picture.
    assert min(float(np.nanmin(track.xy)) for track in tracks) > 50


def test_a_folder_without_anyone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a_1_keypoints.json").write_text('{"people": []}')
    with pytest.raises(DataError, match="no person in any of 1 pictures"):
        read_tracks(tmp_path, frame_rate=25)
    assert read_tracks(tmp_path, frame_rate=25, skeleton="body25") == []


def _results(*, joints: int = 17) -> list[dict[str, Any]]:
    return [
        {
            "image_id": frame,
            "category_id": 1,
            "keypoints": _person(frame, joints, left=left).ravel().tolist(),
            "score": score,
        }
        for frame in range(FRAMES)
        for left, score in ((100, 0.4), (400, 0.8))
    ]


@pytest.mark.parametrize(
    ("joints", "name"),
    [
        (17, "coco17"),
        (23, "coco23"),
        (26, "halpe26"),
        (16, "mpii16"),
        (33, "blazepose33"),
        (25, "body25"),
    ],
)
def test_coco_results_tell_their_skeleton_by_number(tmp_path: Path, joints: int, name: str) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results(joints=joints)))
    tracks = read_tracks(path, frame_rate=30)
    assert [track.skeleton for track in tracks] == [name, name]
    assert len(skeleton.get(name)) == joints
    assert tracks[0].image_size == (0, 0)


def test_a_named_skeleton_wins_over_the_number(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results()))
    assert read_tracks(path, frame_rate=30, skeleton="h36m17")[0].skeleton == "h36m17"


def test_names_of_pictures_give_the_frame(tmp_path: Path) -> None:
    results = _results()
    for entry in results:
        entry["image_id"] = f"shot_02_{entry['image_id'] + 7:04d}.jpg"
    path = tmp_path / "alphapose.json"
    path.write_text(json.dumps(results))
    track = read_tracks(path, frame_rate=30)[0]
    np.testing.assert_array_equal(track.frame, np.arange(7, 7 + FRAMES))


def test_coco_annotations_have_flags_and_a_picture_size(tmp_path: Path) -> None:
    annotations = _results()
    for entry in annotations:
        entry["keypoints"][2::3] = [2, 1, 0] + [2] * 14
        del entry["score"]
    images = [{"id": n, "width": 640, "height": 360} for n in range(FRAMES + 3)]
    path = tmp_path / "annotations.json"
    path.write_text(json.dumps({"images": images, "annotations": annotations}))
    track = read_tracks(path, frame_rate=30)[0]
    assert track.image_size == (640, 360)
    assert len(track) == FRAMES
    assert np.isnan(track.xy[:, 2]).all() and (track.confidence[:, 2] == 0).all()
    assert (track.confidence[:, :2] == 1).all()


def test_unrelated_pictures_are_not_tracked(tmp_path: Path) -> None:
    results = _results()
    results = [r for r in results if r["image_id"] != 4]
    images = [{"id": n, "width": 640, "height": 360} for n in range(FRAMES)]
    path = tmp_path / "photographs.json"
    path.write_text(json.dumps({"images": images, "annotations": results}))
    (track,) = read_tracks(path, independent=True)
    np.testing.assert_array_equal(track.frame, np.arange(FRAMES))
    assert np.isnan(track.xy[4]).all()
    # the surer one of each picture
    np.testing.assert_allclose(track.xy[3, 0], _person(3, 17, left=400)[0, :2], rtol=1e-6)


def test_a_track_file_is_read_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results()))
    track = read_tracks(path, frame_rate=30)[1]
    write_track(tmp_path / "track.npz", track)
    (again,) = read_tracks(tmp_path / "track.npz")
    np.testing.assert_array_equal(again.xy, track.xy)
    assert again.person == 2


def test_a_person_can_be_chosen(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results()))
    (track,) = read_tracks(path, frame_rate=30, person=2)
    assert track.person == 2
    with pytest.raises(UsageError, match="person 3"):
        read_tracks(path, frame_rate=30, person=3)


def test_times_are_not_made_up(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results()))
    with pytest.raises(UsageError, match="frame rate"):
        read_tracks(path)
    with pytest.raises(UsageError, match="frame rate of 0"):
        read_tracks(path, frame_rate=0)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "not a JSON file"),
        ('[{"image_id": 1', "not a JSON file"),
        ("[" * 100_000, "not a JSON file"),
        ("3", "expected a list of keypoint results"),
        ('[{"keypoints": [1, 2, 3]}]', r"no \[0\].image_id"),
        ("[5]", r"no \[0\].image_id"),
        ('[{"image_id": 1}]', r"no \[0\].keypoints"),
        ('[{"image_id": 1, "keypoints": "abc"}]', r"\[0\].keypoints is of type str"),
        ('[{"image_id": 1, "keypoints": [1, 2]}]', r"\[0\].keypoints has 2 numbers"),
        ('[{"image_id": 1, "keypoints": [1, 2, "x"]}]', "plain numbers"),
        ('[{"image_id": 1, "keypoints": [1, [2], 3]}]', "plain numbers"),
        ('[{"image_id": 1, "keypoints": [1, 2, 3]}]', "1 keypoints; known numbers: 16"),
        ('[{"image_id": 1, "keypoints": [1, 2, 3], "score": "high"}]', "score is 'high'"),
        ('{"images": []}', "has no annotations"),
        ('{"images": [], "annotations": 4}', "annotations is of type int"),
        ("[]", "no person"),
    ],
)
def test_what_is_wrong_with_a_json_file_is_said(
    tmp_path: Path, content: str, complaint: str
) -> None:
    path = tmp_path / "results.json"
    path.write_text(content)
    with pytest.raises(DataError, match=complaint) as caught:
        read_tracks(path, frame_rate=25)
    assert str(path) in str(caught.value)


def test_people_with_different_skeletons_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text(json.dumps(_results() + _results(joints=26)))
    with pytest.raises(DataError, match=r"\[18\]\.keypoints has 26 keypoints, expected 17"):
        read_tracks(path, frame_rate=25)


def test_two_pictures_of_one_number_are_refused(tmp_path: Path) -> None:
    _write_openpose(tmp_path, frames=2)
    (tmp_path / "other_000000000040_keypoints.json").write_text('{"people": []}')
    with pytest.raises(DataError, match="two pictures have the number 40"):
        read_tracks(tmp_path, frame_rate=25)


def test_what_is_not_known_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_tracks(tmp_path / "absent.txt", frame_rate=25)
    with pytest.raises(DataError, match="cannot be read"):
        read_tracks(tmp_path / "absent.json", frame_rate=25)
    with pytest.raises(DataError, match=r"holds no \.json file"):
        read_tracks(tmp_path, frame_rate=25)
    (tmp_path / "poses.xml").write_text("<poses/>")
    with pytest.raises(DataError, match="not a form of 2D keypoints"):
        read_tracks(tmp_path / "poses.xml", frame_rate=25)
