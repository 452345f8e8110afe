"""Interlaced video: recognised when it says so and when it does not, and made progressive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dance2pose.video import FrameReader, open_video
from video_making import (
    make_video,
    numbered,
    numbered_video,
    read_number,
    scene,
    with_dancer,
    woven,
)

WIDTH, HEIGHT = 360, 576
COUNT = 30
MARKED = {"flags": "+ilme+ildct"}


def moments() -> list[np.ndarray]:
    """What happened, 50 times a second."""
    background = scene(3, WIDTH, HEIGHT)
    return [with_dancer(background, number / 50) for number in range(2 * COUNT)]


@pytest.fixture(scope="module")
def moving() -> list[np.ndarray]:
    return moments()


def tape(path: Path, moving: list[np.ndarray], order: str, **options: Any) -> Path:
    pictures = [woven(*moving[i : i + 2], fields=order) for i in range(0, len(moving), 2)]
    return make_video(path, pictures, **options)


SAYS_SO: dict[str, dict[str, Any]] = {
    "marked.mpg": dict(codec="mpeg2video", bit_rate=8_000_000, options=MARKED),
    "marked.mp4": dict(options={"x264-params": "tff=1", "qp": "10"}),
    "marked.mkv": dict(codec="ffv1", pixel_format="yuv422p", options=MARKED),
}
SAYS_NOT: dict[str, dict[str, Any]] = {
    "unmarked.mpg": dict(codec="mpeg2video", bit_rate=8_000_000),
    "unmarked.mp4": dict(options={"qp": "10"}),
    "unmarked.mkv": dict(codec="ffv1", pixel_format="yuv422p"),
}


def error(path: Path, truth: list[np.ndarray], **options: Any) -> tuple[float, FrameReader]:
    """Mean difference from the moments of the first fields in grey levels, where the picture
    changes before the second field; and the reader."""
    with open_video(path, **options) as video:
        frames = [frame.image.mean(axis=2) for frame in video]
    assert len(frames) == COUNT
    differences = []
    for number, image in enumerate(frames):
        first, second = (moment.mean(axis=2) for moment in truth[2 * number : 2 * number + 2])
        differences.append(np.abs(image - first)[np.abs(first - second) > 40].mean())
    return float(np.mean(differences)), video


@pytest.mark.parametrize("order", ["tff", "bff"])
@pytest.mark.parametrize("name", [*SAYS_SO, *SAYS_NOT])
def test_fields_are_found_and_made_whole(
    name: str, order: str, moving: list[np.ndarray], tmp_path: Path
) -> None:
    marked = name in SAYS_SO
    options = {**SAYS_SO, **SAYS_NOT}[name]
    if name == "marked.mp4":
        options = dict(options={"x264-params": f"{order}=1", "qp": "10"})
    path = tape(tmp_path / name, moving, order, fields=order if marked else None, **options)
    whole, video = error(path, moving)
    combed, _ = error(path, moving, deinterlace="off")
    assert video.info.interlaced and video.deinterlaced
    assert ("marked interlaced" in video.info.interlaced_because) == marked
    if not marked:
        expected = {"tff": "top field first", "bff": "bottom field first"}[order]
        assert video.info.field_order == expected
    assert whole < 0.5 * combed, (whole, combed)


@pytest.mark.parametrize("name", SAYS_NOT)
def test_progressive_video_is_left_alone(
    name: str, moving: list[np.ndarray], tmp_path: Path
) -> None:
    path = make_video(tmp_path / name, moving[::2], **SAYS_NOT[name])
    with open_video(path) as video:
        assert sum(1 for _ in video) == COUNT
    assert not video.info.interlaced and not video.deinterlaced
    assert video.info.interlaced_because == ""


def test_off_means_off(moving: list[np.ndarray], tmp_path: Path) -> None:
    path = tape(tmp_path / "a.mkv", moving, "tff", codec="ffv1", pixel_format="yuv422p")
    with open_video(path, deinterlace="off") as video:
        image = next(iter(video)).image.astype(int)
    assert video.info.interlaced and not video.deinterlaced
    combed = woven(moving[0], moving[1]).astype(int)
    # Chroma is halved across, so compare brightness.
    assert np.abs(image.mean(axis=2) - combed.mean(axis=2)).mean() < 3


@pytest.mark.parametrize("count", [1, 2, 5])
def test_no_frame_is_lost_or_moved(count: int, tmp_path: Path) -> None:
    path = numbered_video(
        tmp_path / "a.mpg", count, codec="mpeg2video", fields="tff", options=MARKED
    )
    with open_video(path) as video:
        frames = list(video)
    assert video.deinterlaced
    assert [frame.index for frame in frames] == list(range(count))
    assert [read_number(frame.image) for frame in frames] == list(range(count))
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(count) / 25, atol=1e-3)


def test_fields_that_begin_half_way(tmp_path: Path) -> None:
    """A progressive recording joined with an interlaced one: each picture's own mark counts."""
    plain = numbered_video(tmp_path / "1.ts", codec="mpeg2video").read_bytes()
    fields = make_video(
        tmp_path / "2.ts",
        [numbered(number) for number in range(12)],
        codec="mpeg2video",
        fields="tff",
        options=MARKED,
    ).read_bytes()
    (tmp_path / "joined.ts").write_bytes(plain + fields)
    with open_video(tmp_path / "joined.ts") as video:
        numbers = [read_number(frame.image) for frame in video]
    assert not video.info.interlaced and video.deinterlaced
    assert numbers == [*range(12), *range(12)]


@pytest.mark.shared
@pytest.mark.parametrize("name", ["contemporary_dance", "two_walkers"])
def test_real_movement_as_tape_and_as_film(shared: Path, name: str, tmp_path: Path) -> None:
    """Real dancers at a tape's size: recognised when woven, left alone when not."""
    import cv2

    with open_video(shared / "videos" / f"{name}.mp4", end_s=2.0) as video:
        images = [cv2.resize(frame.image, (720, 576)) for frame in video]
    pairs = zip(images[::2], images[1::2], strict=True)
    film = make_video(tmp_path / "film.mp4", images, options={"crf": "18"})
    tape = make_video(tmp_path / "tape.mp4", [woven(*pair) for pair in pairs])
    for path, interlaced in ((film, False), (tape, True)):
        with open_video(path) as opened:
            assert opened.info.interlaced == interlaced
