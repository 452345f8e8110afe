"""One suite for every format: two planted people come back, whatever tool wrote them."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dance2pose import skeleton
from dance2pose.errors import Dance2PoseError, DataError, UsageError
from dance2pose.lifting import lift
from dance2pose.poses import Track2D
from dance2pose.reading import ReadTracks, read_tracks
from reading_making import HEIGHT, MADE, RATE, WIDTH, Person, Scene, scene

FORMATS = pytest.mark.parametrize("name", MADE)


def _read(path: Path, name: str, **options: Any) -> ReadTracks:
    made = MADE[name]
    given = {} if made.times else {"frame_rate": RATE}
    if made.needs_size:
        given["image_size"] = (WIDTH, HEIGHT)
    return read_tracks(path, **(given | options))


def _write(name: str, folder: Path, frames: Scene) -> Path:
    if name.endswith("h5"):
        pytest.importorskip("h5py")
    if name == "deeplabcut h5":
        pytest.importorskip("tables")
    return MADE[name].write(folder, frames)


def _of(tracks: list[Track2D], who: str) -> Track2D:
    left = {"ann": 0, "bo": 1}[who]
    return sorted(tracks, key=lambda track: float(np.nanmean(track.xy[..., 0])))[left]


def _check(track: Track2D, frames: Scene, who: str, name: str) -> None:
    """Every row in which the person was seen is as planted."""
    made = MADE[name]
    for row, frame in enumerate(track.frame):
        person = next((p for p in frames.get(int(frame), []) if p.who == who), None)
        if person is None:
            continue
        seen = person.keypoints[:, 2] > 0
        np.testing.assert_allclose(
            track.xy[row, seen], person.keypoints[seen, :2], atol=2e-3, err_msg=f"frame {frame}"
        )
        sure = np.ones(seen.sum()) if made.flags else person.keypoints[seen, 2]
        np.testing.assert_allclose(track.confidence[row, seen], sure, atol=1e-6)


@FORMATS
def test_the_planted_people_come_back(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, people=made.people)
    found = _read(_write(name, tmp_path, frames), name)
    assert len(found.tracks) == made.people
    assert [track.person for track in found.tracks] == list(range(1, made.people + 1))
    for who in ("ann", "bo")[: made.people]:
        track = _of(found.tracks, who)
        assert track.skeleton == made.skeleton
        np.testing.assert_array_equal(track.frame, list(frames))
        np.testing.assert_allclose(track.time_s, track.frame / RATE)
        assert not track.interpolated.any()
        _check(track, frames, who, name)
    assert any(made.skeleton in note for note in found.notes) or made.skeleton == "blazepose33"
    assert not any("implausible" in note for note in found.notes)


@FORMATS
def test_what_was_read_can_be_lifted(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    found = _read(_write(name, tmp_path, scene(made.skeleton, people=made.people)), name)
    poses = lift(found.tracks[0], camera="weak-perspective")
    assert np.isfinite(poses.xyz).all()
    assert float(np.nanmean(poses.reprojection_error)) < 10


@FORMATS
def test_a_short_hole_is_filled_and_marked_whether_its_frames_are_listed_or_not(
    name: str, tmp_path: Path
) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, range(40), people=made.people)
    for frame in (11, 12, 13):
        frames[frame] = []
    tracks = _read(_write(name, tmp_path, frames), name).tracks
    for track in tracks:
        np.testing.assert_array_equal(np.flatnonzero(track.interpolated), [11, 12, 13])
        assert np.isfinite(track.xy).all()
        np.testing.assert_array_equal(track.frame, np.arange(40))
    if not made.leaves_out:
        return
    for frame in (11, 12, 13):
        del frames[frame]
    (tmp_path / "absent").mkdir()
    for one, other in zip(
        tracks, _read(_write(name, tmp_path / "absent", frames), name).tracks, strict=True
    ):
        np.testing.assert_allclose(other.xy, one.xy, atol=1e-4)
        np.testing.assert_array_equal(other.frame, one.frame)
        np.testing.assert_array_equal(other.interpolated, one.interpolated)


@FORMATS
def test_a_hole_too_long_to_fill_stays_one(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, [*range(20), *range(45, 70)], people=made.people)
    for track in _read(_write(name, tmp_path, frames), name).tracks:
        away = (track.frame > 19) & (track.frame < 45)
        assert np.isnan(track.xy[away]).all()
        assert np.isfinite(track.xy[~away]).all()
        assert not track.interpolated.any()


@FORMATS
def test_a_keypoint_at_zero_is_a_missing_one(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, range(40), people=1)
    wrist = skeleton.get(made.skeleton).index("left_wrist")
    truth = frames[20][0].keypoints[wrist, :2].copy()
    for frame in range(15, 25):
        frames[frame][0].keypoints[wrist] = (0, 0, 0.35)
    (track,) = _read(_write(name, tmp_path, frames), name).tracks
    if np.isfinite(track.xy[20, wrist]).all():
        np.testing.assert_allclose(track.xy[20, wrist], truth, atol=8)
    assert float(np.nanmin(track.xy)) > 20


@FORMATS
def test_the_order_of_entries_means_nothing(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, people=made.people)
    order = list(frames)
    random.Random(5).shuffle(order)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    straight = _read(_write(name, tmp_path / "a", frames), name).tracks
    shuffled = _read(
        _write(name, tmp_path / "b", {f: list(reversed(frames[f])) for f in order}), name
    ).tracks
    assert len(straight) == len(shuffled)
    for who in ("ann", "bo")[: made.people]:
        one, other = _of(straight, who), _of(shuffled, who)
        np.testing.assert_array_equal(one.frame, other.frame)
        np.testing.assert_allclose(one.xy, other.xy, atol=1e-6)


@FORMATS
def test_a_missing_size_says_what_is_lost_by_it_or_is_asked_for(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    path = _write(name, tmp_path, scene(made.skeleton, people=made.people))
    if made.needs_size:
        with pytest.raises(UsageError, match="--image-size"):
            read_tracks(path, frame_rate=RATE)
        return
    found = _read(path, name)
    known = found.tracks[0].image_size != (0, 0)
    assert known != any("path through the room" in note for note in found.notes)
    found = _read(path, name, image_size=(WIDTH, HEIGHT))
    assert found.tracks[0].image_size == (WIDTH, HEIGHT)
    assert not any("path through the room" in note for note in found.notes)


@FORMATS
def test_one_person_can_be_asked_for(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    path = _write(name, tmp_path, scene(made.skeleton, people=made.people))
    (track,) = _read(path, name, person=made.people).tracks
    assert track.person == made.people
    with pytest.raises(UsageError, match="person 5"):
        _read(path, name, person=5)


@FORMATS
def test_unrelated_pictures_give_a_row_each(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    frames = scene(made.skeleton, people=made.people)
    path = _write(name, tmp_path, frames)
    options = {"image_size": (WIDTH, HEIGHT)} if made.needs_size else {}
    (track,) = read_tracks(path, independent=True, **options).tracks
    assert len(track) >= len(frames)
    np.testing.assert_array_equal(track.time_s, np.arange(len(track)))


@FORMATS
@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(share=st.floats(0, 1), noise=st.binary(max_size=6))
def test_a_damaged_file_is_read_or_refused_and_nothing_else(
    name: str, tmp_path_factory: pytest.TempPathFactory, share: float, noise: bytes
) -> None:
    made = MADE[name]
    path = _write(name, tmp_path_factory.mktemp("damaged"), scene(made.skeleton, range(4)))
    file = sorted(path.iterdir())[1] if path.is_dir() else path
    data = file.read_bytes()
    cut = int(share * len(data))
    file.write_bytes(data[:cut] + noise)
    try:
        _read(path, name)
    except Dance2PoseError as error:
        assert str(tmp_path_factory.getbasetemp()) in str(error) or isinstance(error, UsageError)
        assert "\n" not in str(error)


@FORMATS
def test_a_file_cut_after_any_of_its_first_lines_is_read_or_refused(
    name: str, tmp_path: Path
) -> None:
    path = _write(name, tmp_path, scene(MADE[name].skeleton, range(4)))
    file = sorted(path.iterdir())[1] if path.is_dir() else path
    data = file.read_bytes()
    ends = [at + 1 for at, byte in enumerate(data) if byte == ord("\n")][:8]
    for cut in [0, *ends]:  # of a table, also just after its header
        file.write_bytes(data[:cut])
        try:
            _read(path, name)
        except Dance2PoseError as error:
            assert str(tmp_path) in str(error)


@FORMATS
def test_times_are_not_made_up(name: str, tmp_path: Path) -> None:
    made = MADE[name]
    path = _write(name, tmp_path, scene(made.skeleton, people=made.people))
    if made.times:
        assert read_tracks(path).tracks
        return
    with pytest.raises(UsageError, match="frame rate"):
        read_tracks(path, **({"image_size": (WIDTH, HEIGHT)} if made.needs_size else {}))


def test_people_of_different_skeletons_are_refused(tmp_path: Path) -> None:
    frames = scene("coco17")
    frames[8][1] = Person("bo", scene("halpe26")[8][1].keypoints)
    path = MADE["results"].write(tmp_path, frames)
    with pytest.raises(DataError, match=r"\[11\]\.keypoints has 26 keypoints, expected 17"):
        read_tracks(path, frame_rate=RATE)
