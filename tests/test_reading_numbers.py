"""Numbers that are names: which frame of which video a picture is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.errors import DataError
from dance2pose.reading import read_tracks
from dance2pose.reading.content import Picture
from dance2pose.reading.numbering import numbered
from reading_making import MADE, RATE, scene


def _named(*names: str) -> list[tuple[str, list[int]]]:
    found, _ = numbered([Picture([], name=name) for name in names], "FILE")
    return [(video.video, video.frames) for video in found]


@pytest.mark.parametrize(
    ("names", "frames"),
    [
        (["dance.mp4_0", "dance.mp4_2", "dance.mp4_11"], [0, 2, 11]),
        (["cam2.00029", "cam2.00031"], [29, 31]),
        (["frame_00030.jpg", "frame_00031 (1).jpg", "frame_00032.jpg"], [30, 31, 32]),
        (["pic (1).jpg", "pic (2).jpg", "pic (10).jpg"], [1, 2, 10]),
        (["take2 (1).jpg", "take2 (2).jpg"], [1, 2]),
        (["f_8_v2.png", "f_9_v2.png"], [8, 9]),
        (["take2_000000000040_keypoints.json", "take2_000000000041_keypoints.json"], [40, 41]),
        (["0.jpg", "1.jpg", "2.jpg"], [0, 1, 2]),
        (["0007_30fps.jpg", "0008_30fps.jpg"], [7, 8]),
        (["dance_1920x1080_4.jpg", "dance_1920x1080_5.jpg"], [4, 5]),
        (["frame_00003.jpg.json", "frame_00004.jpg.json"], [3, 4]),
        (["a\\b\\000003.jpg", "a\\b\\000004.jpg"], [3, 4]),
        (["f_1.jpg", "f_2.jpeg", "f_3.PNG"], [1, 2, 3]),
    ],
)
def test_the_number_in_a_name_is_found_whatever_stands_around_it(
    names: list[str], frames: list[int]
) -> None:
    ((_, found),) = _named(*names)
    assert found == frames


@pytest.mark.parametrize(
    ("pattern", "videos"),
    [
        ("cam{}_{:04d}.jpg", ["cam1", "cam2"]),
        ("takes/{}/{:06d}.jpg", ["takes/1/", "takes/2/"]),
        ("dance{}.mp4_{}", ["dance1.mp4", "dance2.mp4"]),
        ("{}_{:05d} (1).jpg", ["1", "2"]),
    ],
)
def test_several_videos_are_kept_apart(pattern: str, videos: list[str]) -> None:
    names = [pattern.format(video, frame) for frame in (3, 4, 5) for video in (1, 2)]
    assert _named(*names) == [(video, [3, 4, 5]) for video in videos]


def test_names_without_numbers_and_hashes_leave_the_order_to_the_ids() -> None:
    pictures = [
        Picture([], name=name, key=key)
        for name, key in (("a3f9.png", 3), ("b77c.png", 1), ("09ad.png", 2))
    ]
    (video,), notes = numbered(pictures, "FILE")
    assert [picture.name for picture in video.pictures] == ["b77c.png", "09ad.png", "a3f9.png"]
    assert notes == ["the names of the pictures hold no frame numbers; the id holds"]


def test_numbers_too_large_for_a_frame_are_none() -> None:
    (video,), _ = numbered([Picture([], key=10**17 + n) for n in (2, 1, 0)], "FILE")
    assert video.frames == [0, 1, 2]


def test_a_stated_frame_comes_before_the_name_and_the_name_before_the_id() -> None:
    pictures = [Picture([], name=f"f_{n}.jpg", frame=10 * n, key=99 - n) for n in range(1, 4)]
    (video,), notes = numbered(pictures, "FILE")
    assert video.frames == [10, 20, 30]
    assert notes == [
        "the frame number stated and the id put the pictures in another order;"
        " the frame number stated holds"
    ]


def test_two_pictures_of_one_number_are_named() -> None:
    with pytest.raises(DataError, match=r"number 31: 'f_31.jpg' and 'f_31 \(1\).jpg'"):
        _named("f_30.jpg", "f_31.jpg", "f_31 (1).jpg")


@settings(deadline=None)
@given(
    numbers=st.lists(st.integers(0, 99_999), min_size=3, max_size=20, unique=True),
    head=st.from_regex(r"[a-z]{0,4}[ _.-]?", fullmatch=True),
    width=st.integers(1, 12),
    tail=st.sampled_from(["", ".jpg", ".PNG", "_keypoints.json", "_v2.png", "@2x.jpg"]),
)
def test_any_numbers_come_back_from_any_names(
    numbers: list[int], head: str, width: int, tail: str
) -> None:
    assert [frames for _, frames in _named(*(f"{head}{n:0{width}d}{tail}" for n in numbers))] == [
        sorted(numbers)
    ]


@settings(max_examples=15, deadline=None)
@given(ids=st.permutations(range(12)), first=st.integers(0, 100), step=st.sampled_from([1, 2, 5]))
def test_random_ids_do_not_change_the_motion(
    tmp_path_factory: pytest.TempPathFactory, ids: list[int], first: int, step: int
) -> None:
    frames = scene("coco17", range(first, first + 12 * step, step), people=1)
    path = MADE["coco"].write(tmp_path_factory.mktemp("ids"), frames)
    content = json.loads(path.read_text())
    new = {image["id"]: ids[n] for n, image in enumerate(content["images"])}
    for image in content["images"]:
        image["id"] = new[image["id"]]
    for one in content["annotations"]:
        one["image_id"] = new[one["image_id"]]
    path.write_text(json.dumps(content))
    (track,) = read_tracks(path, frame_rate=RATE).tracks
    np.testing.assert_array_equal(track.frame, list(frames))
    np.testing.assert_allclose(track.time_s, track.frame / RATE)
    planted = [people[0].keypoints[:, :2] for people in frames.values()]
    np.testing.assert_allclose(track.xy, planted, atol=1e-3)


def _results(names: list[Any]) -> list[dict[str, Any]]:
    entries = []
    for n, name in enumerate(names):
        (person,) = scene("coco17", [n], people=1)[n]
        entries.append({"image_id": name, "keypoints": person.keypoints.ravel().tolist()})
    return entries


def test_two_videos_in_one_file_are_two_shots(tmp_path: Path) -> None:
    names = [f"cam{c}_{n:04d}.jpg" for n in range(12) for c in (1, 2)]
    path = tmp_path / "two.json"
    path.write_text(json.dumps(_results(names)))
    found = read_tracks(path, frame_rate=RATE)
    assert sorted((track.shot, len(track)) for track in found.tracks) == [(0, 12), (1, 12)]
    assert "2 videos are in it, each followed by itself: 'cam1', 'cam2'" in found.notes


def test_video_ids_of_coco_keep_videos_apart(tmp_path: Path) -> None:
    frames = scene("coco17", range(8), people=1)
    path = MADE["coco"].write(tmp_path, frames)
    content = json.loads(path.read_text())
    for n, image in enumerate(content["images"]):
        image["video_id"], image["frame_id"] = n % 2, n // 2
        del image["file_name"]
    path.write_text(json.dumps(content))
    found = read_tracks(path, frame_rate=RATE, person="all")
    assert sorted((track.shot, track.frame.tolist()) for track in found.tracks) == [
        (0, [0, 1, 2, 3]),
        (1, [0, 1, 2, 3]),
    ]


def test_every_fifth_frame_is_a_fifth_of_the_frames(tmp_path: Path) -> None:
    path = MADE["coco"].write(tmp_path, scene("coco17", range(0, 60, 5), people=1))
    (track,) = read_tracks(path, frame_rate=30).tracks
    np.testing.assert_array_equal(track.frame, np.arange(0, 60, 5))
    np.testing.assert_allclose(track.time_s[:3], [0, 5 / 30, 10 / 30])
