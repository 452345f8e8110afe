"""Keypoint files that went wrong for users of other tools, with the figures that are right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dance2pose.commands.smooth import smooth
from dance2pose.lifting import lift
from dance2pose.poses import Track3D
from dance2pose.reading import ReadTracks, read_tracks
from dance2pose.smoothing import smooth_track

pytestmark = pytest.mark.shared


def _read(shared: Path, name: str, size: tuple[int, int] = (384, 496)) -> ReadTracks:
    return read_tracks(shared / "cases" / name, frame_rate=30, image_size=size)


def _lifted(shared: Path, name: str) -> Track3D:
    (track,) = _read(shared, name).tracks
    return lift(track, height_m=1.7)


def _furthest_mm(one: Track3D, other: Track3D) -> float:
    return 1000 * float(np.nanmax(np.linalg.norm(one.xyz - other.xyz, axis=2)))


def test_shuffled_ids_are_read_in_the_order_of_the_file_names(shared: Path, tmp_path: Path) -> None:
    """As the same file with its ids in order; read in the order of the ids it was 13.6 px off."""
    found = _read(shared, "coco_shuffled_ids.json")
    assert any("the file name holds" in note for note in found.notes)
    document = json.loads((shared / "cases" / "coco_shuffled_ids.json").read_text())
    names = {image["id"]: image["file_name"] for image in document["images"]}
    in_order = {old: new for new, old in enumerate(sorted(names, key=names.__getitem__))}
    for image in document["images"]:
        image["id"] = in_order[image["id"]]
    for person in document["annotations"]:
        person["image_id"] = in_order[person["image_id"]]
    (tmp_path / "in_order.json").write_text(json.dumps(document))
    size = found.tracks[0].image_size
    (track,) = read_tracks(tmp_path / "in_order.json", frame_rate=30, image_size=size).tracks
    np.testing.assert_array_equal(track.xy, found.tracks[0].xy)
    poses = lift(found.tracks[0])
    assert float(np.nanmean(poses.reprojection_error)) < 6


def test_every_fifth_frame_is_at_its_own_time(shared: Path) -> None:
    (track,) = _read(shared, "coco_every_fifth_frame.json").tracks
    np.testing.assert_array_equal(track.frame[:3], [0, 5, 10])
    np.testing.assert_allclose(track.time_s[:2], [0, 1 / 6])


def test_absent_frames_are_as_if_they_were_listed(shared: Path) -> None:
    (absent,) = _read(shared, "alphapose_absent_frames.json").tracks
    (listed,) = _read(shared, "coco_empty_frames_listed.json").tracks
    np.testing.assert_array_equal(absent.frame, listed.frame)
    np.testing.assert_array_equal(np.flatnonzero(absent.interpolated), range(40, 45))
    assert np.isnan(absent.xy[70:100]).all()
    assert _furthest_mm(lift(absent, height_m=1.7), lift(listed, height_m=1.7)) < 1
    for model in ("mma", "butterworth"):
        one, other = (
            smooth_track(lift(track, height_m=1.7), model=model) for track in (absent, listed)
        )
        assert np.isnan(one.xyz[70:100]).all()
        assert _furthest_mm(one, other) < 1


def test_two_people_a_minute_apart_are_two_dancers(shared: Path) -> None:
    found = _read(shared, "alphapose_two_people_60s_apart.json", (1920, 1080))
    assert [len(track) for track in found.tracks] == [60, 60]


def test_zeroed_keypoints_are_as_if_marked_missing(shared: Path) -> None:
    zeroed = _lifted(shared, "zeroed_keypoints.json")
    marked = _lifted(shared, "zeroed_keypoints_marked_missing.json")
    assert _furthest_mm(zeroed, marked) == 0
    whole = _lifted(shared, "coco_shuffled_ids.json")
    off_mm = 1000 * np.linalg.norm(zeroed.xyz - whole.xyz, axis=2)
    assert off_mm[50:60].mean() < 15  # where a wrist and an ankle were at (0, 0)


def test_a_whole_body_of_133_keypoints_is_read(shared: Path) -> None:
    found = _read(shared, "alphapose_133_keypoints.json")
    assert found.tracks[0].skeleton == "wholebody133"
    assert "133 keypoints read as wholebody133" in found.notes
    assert np.isfinite(lift(found.tracks[0]).xyz).all()


def test_a_second_without_rows_is_not_smoothed_across(shared: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    smooth(shared / "cases" / "hole_in_time.csv", output=out, quiet=True)
    values = [float(line.split(",")[2]) for line in out.read_text().splitlines()[1:]]
    assert sorted(set(values)) == [0, 100]
    assert values == sorted(values)
