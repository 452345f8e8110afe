"""Of several video tracks the film is read; each picture is shown as it says itself."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.poses import Frame
from dance2pose.recording.picture import choose_picture
from dance2pose.shots import ShotDetector
from dance2pose.video import FrameReader, open_video
from video_making import (
    TrackPlan,
    make_tracks,
    make_video,
    numbered,
    numbered_video,
    read_number,
    scene,
    with_dancer,
)


def read(path: Path) -> tuple[list[Frame], FrameReader]:
    with open_video(path) as video:
        return list(video), video


def numbers(frames: list[Frame]) -> list[int]:
    return [read_number(frame.image) for frame in frames]


POSTER = TrackPlan(1, first=200, width=256, height=192)
FILM = TrackPlan(30)


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv"])
@pytest.mark.parametrize("tracks", [[FILM, POSTER], [POSTER, FILM]])
def test_a_poster_is_no_film_however_large_and_wherever_it_stands(
    tracks: list[TrackPlan], name: str, tmp_path: Path
) -> None:
    frames, video = read(make_tracks(tmp_path / name, tracks))
    assert numbers(frames) == list(range(30))
    place = tracks.index(POSTER)
    assert video.info.track == 1 - place
    assert video.warnings == [
        f"of several video tracks, track {1 - place} was read; left out: "
        f"track {place} (h264, 256 x 192 px, 1 picture)"
    ]
    assert not video.damaged


def test_a_poster_marked_as_the_default_track(tmp_path: Path) -> None:
    poster = TrackPlan(1, first=200, width=256, height=192, is_default=True)
    frames, _ = read(make_tracks(tmp_path / "a.mkv", [poster, FILM]))
    assert numbers(frames) == list(range(30))


def test_slides_over_a_longer_time_are_no_film(tmp_path: Path) -> None:
    slides = TrackPlan(6, rate=1, first=200, width=256, height=192)
    frames, _ = read(make_tracks(tmp_path / "a.mkv", [slides, FILM]))
    assert numbers(frames) == list(range(30))


def test_of_two_equal_films_the_default_one_and_then_the_larger(tmp_path: Path) -> None:
    small, large = TrackPlan(30), TrackPlan(30, first=100, width=256, height=192)
    frames, _ = read(make_tracks(tmp_path / "a.mkv", [small, large]))
    assert numbers(frames)[0] == 100
    marked = TrackPlan(30, is_default=True)
    frames, _ = read(make_tracks(tmp_path / "b.mkv", [large, marked]))
    assert numbers(frames)[0] == 0


def test_reading_from_the_middle_stays_on_the_track(tmp_path: Path) -> None:
    path = make_tracks(tmp_path / "a.mp4", [POSTER, TrackPlan(250)])
    with open_video(path, start_s=8) as video:
        frames = list(video)
    assert numbers(frames) == list(range(200, 250))
    assert not video.damaged


def test_a_file_of_several_tracks_is_not_recorded_as_a_file(tmp_path: Path) -> None:
    """The viewer would show the track it likes."""
    _, video = read(make_tracks(tmp_path / "a.mp4", [FILM, POSTER]))
    choice = choose_picture(video.info)
    assert choice.mode == "frames" and "another track" in choice.reason


@st.composite
def plans(draw: st.DrawFn) -> list[TrackPlan]:
    """One film among up to three tracks of one picture each, of any size and flag."""
    posters = [
        TrackPlan(
            1,
            start_ms=draw(st.sampled_from([0, 40, 500])),
            first=200,
            width=draw(st.sampled_from([64, 128, 256])),
            is_default=draw(st.booleans()),
        )
        for _ in range(draw(st.integers(1, 3)))
    ]
    film = TrackPlan(
        draw(st.integers(3, 20)),
        rate=draw(st.sampled_from([5, 25])),
        is_default=draw(st.booleans()),
    )
    return draw(st.permutations([film, *posters]))


@given(plans(), st.sampled_from(["a.mkv", "a.mov"]))
@settings(max_examples=15, deadline=None)
def test_the_film_is_found_among_any_posters(tracks: list[TrackPlan], name: str) -> None:
    with TemporaryDirectory() as folder:
        path = make_tracks(Path(folder) / name, tracks, codec="mjpeg", pixel_format="yuvj420p")
        frames, video = read(path)
    film = next(plan for plan in tracks if plan.count > 1)
    assert numbers(frames) == list(range(film.count))
    assert video.info.track == tracks.index(film)
    assert len(video.info.other_tracks) == len(tracks) - 1
    assert not video.damaged


# What each picture says of itself ---------------------------------------------------------------


def shape_change(path: Path, *, scene_seed: int = 4) -> Path:
    """A transport stream of one coded size: 4:3 and then 16:9, of one view of the same dancer."""
    background = scene(scene_seed, 1024, 576)
    parts = []
    for number, aspect in enumerate((Fraction(16, 15), Fraction(64, 45))):
        pictures = [with_dancer(background, (number * 25 + i) / 25) for i in range(25)]
        if aspect == Fraction(16, 15):  # the middle of the same view
            pictures = [picture[:, 128:-128] for picture in pictures]
        part = make_video(
            path.with_name(f"{number}.ts"),
            (squeezed(picture) for picture in pictures),
            codec="mpeg2video",
            sample_aspect=aspect,
            bit_rate=4_000_000,
        )
        parts.append(part.read_bytes())
    path.write_bytes(b"".join(parts))
    return path


def squeezed(picture: np.ndarray) -> np.ndarray:
    import cv2

    return np.asarray(cv2.resize(picture, (720, 576)), np.uint8)


def test_pixel_shape_that_changes_on_the_way(tmp_path: Path) -> None:
    frames, video = read(shape_change(tmp_path / "a.ts"))
    assert video.info.size == (1024, 576)
    assert video.info.sample_aspect_ratio == Fraction(16, 15)
    assert [frame.inner for frame in frames] == [(128, 0, 768, 576)] * 25 + [None] * 25
    background = scene(4, 1024, 576).astype(int)
    for number in (0, 24, 25, 49):
        image = frames[number].image[:, 160:-160].astype(int)
        expected = with_dancer(background.astype(np.uint8), number / 25)[:, 160:-160].astype(int)
        assert np.abs(image - expected).mean() < 8, number


def test_a_change_of_format_is_no_cut(tmp_path: Path) -> None:
    """Nor is it where the wider pictures come as a surprise and are made smaller to fit."""
    frames, _ = read(shape_change(tmp_path / "a.ts"))
    detector = ShotDetector()
    assert not any(detector.is_cut(frame) for frame in frames)
    narrow = [scene(7, 320, 240)] * 3
    small = np.zeros_like(narrow[0])
    import cv2

    small[30:210] = cv2.resize(narrow[0], (320, 180))
    detector = ShotDetector()
    pictures = [Frame(i, i / 25, image) for i, image in enumerate(narrow)]
    pictures.append(Frame(3, 3 / 25, small, (0, 30, 320, 180)))
    assert not any(detector.is_cut(frame) for frame in pictures)


def test_a_container_that_states_the_shape_wins_over_the_pictures(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 6, sample_aspect=Fraction(4, 3))
    data = bytearray(path.read_bytes())
    place = data.index(b"pasp") + 4
    data[place : place + 8] = (2).to_bytes(4, "big") + (1).to_bytes(4, "big")
    path.write_bytes(data)
    frames, video = read(path)
    assert video.info.size == (256, 96) and all(frame.inner is None for frame in frames)


def test_sizes_that_change_on_the_way(tmp_path: Path) -> None:
    """As recordings of adaptive streams do; the frames keep one size."""
    parts = [
        make_video(
            tmp_path / f"{number}.ts",
            [numbered(number * 10 + i, width, height) for i in range(10)],
            codec="mpeg2video",
            bit_rate=2_000_000,
        ).read_bytes()
        for number, (width, height) in enumerate([(128, 96), (256, 192), (192, 96)])
    ]
    (tmp_path / "a.ts").write_bytes(b"".join(parts))
    frames, video = read(tmp_path / "a.ts")
    assert {frame.image.shape for frame in frames} == {(96, 192, 3)}
    shown = numbers([Frame(f.index, f.time_s, cut_out(f)) for f in frames])
    # FFmpeg's MPEG-2 decoder drops the picture it still holds when the size changes.
    assert shown == [number for number in range(30) if number not in (9, 19)]
    assert "another size or shape" in " ".join(video.warnings)


def cut_out(frame: Frame) -> np.ndarray:
    if frame.inner is None:
        return frame.image
    left, top, width, height = frame.inner
    return np.ascontiguousarray(frame.image[top : top + height, left : left + width])


# The files of the case collection ---------------------------------------------------------------


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "count", "left_out"),
    [
        ("poster_beside_film", 60, "768 x 992 px, 1 picture"),
        ("two_films", 30, "884 x 498 px, 17 pictures"),
    ],
)
def test_real_files_of_two_tracks(name: str, count: int, left_out: str, shared: Path) -> None:
    frames, video = read(shared / "cases" / f"{name}.mp4")
    assert len(frames) == count and frames[0].image.shape == (496, 384, 3)
    assert left_out in video.warnings[0]
    assert choose_picture(video.info).mode == "frames"


@pytest.mark.shared
def test_a_real_change_of_pixel_shape(shared: Path) -> None:
    detector = ShotDetector()
    with open_video(shared / "cases" / "pixel_aspect_changes.ts") as video:
        inner = []
        for frame in video:
            assert not detector.is_cut(frame)
            inner.append(frame.inner)
    assert video.info.size == (1024, 576)
    assert inner == [(128, 0, 768, 576)] * 50 + [None] * 50
