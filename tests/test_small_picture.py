"""The small grey picture is the same whether made from the stored brightness or from colours."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from av.video.frame import VideoFrame

from dance2pose.poses import Frame
from dance2pose.small_picture import SIZE, small_grey, small_size
from dance2pose.video import open_video
from dance2pose.video.picture import Orientation, PictureMaker
from video_making import make_video, scene

# Rounding, and matrices that weigh colours a little otherwise than OpenCV's grey.
LARGEST_MEAN_DIFFERENCE = 6.0


@pytest.mark.parametrize(
    ("options", "from_brightness"),
    [
        ({"pixel_format": "yuv420p"}, True),
        ({"pixel_format": "yuv444p"}, True),
        ({"codec": "mjpeg", "pixel_format": "yuvj420p"}, True),
        ({"turned": (90, False, False)}, True),
        ({"turned": (180, True, False)}, True),
        ({"sample_aspect": Fraction(4, 3)}, True),
        ({"codec": "ffv1", "pixel_format": "yuv422p10le"}, False),
        ({"codec": "ffv1", "pixel_format": "bgr0"}, False),
        ({"codec": "ffv1", "pixel_format": "gray"}, False),  # of full range, and does not say so
    ],
)
def test_brightness_and_colours_give_one_small_picture(
    tmp_path: Path, options: dict[str, Any], from_brightness: bool
) -> None:
    pictures = [scene(3, width=640, height=368)] * 3
    suffix = ".mkv" if "codec" in options else ".mp4"
    with open_video(make_video(tmp_path / f"a{suffix}", pictures, **options)) as video:
        frame = next(iter(video))
    height, width = frame.image.shape[:2]
    assert (frame.decoded_small is not None) == from_brightness
    assert frame.small.shape == small_size(width, height)[::-1]
    assert max(frame.small.shape) == SIZE
    expected = small_grey(frame.image).astype(float)
    assert np.abs(frame.small - expected).mean() < LARGEST_MEAN_DIFFERENCE
    assert np.corrcoef(frame.small.ravel(), expected.ravel())[0, 1] > 0.98


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (700, 500), (384, 496), (30, 40)])
def test_what_is_at_a_place_stays_there(width: int, height: int) -> None:
    rows, columns = np.mgrid[0:height, 0:width]
    ramp = (columns * 255 // (width - 1), rows * 255 // (height - 1), np.zeros_like(rows))
    for channel, axis in ((0, 1), (1, 0)):
        image = np.zeros((height, width, 3), np.uint8)
        image[:] = np.asarray(ramp[channel], np.uint8)[..., None]
        small = Frame(0, 0.0, image).small
        length = small.shape[axis]
        expected = ((np.arange(length) + 0.5) * image.shape[axis] / length - 0.5) * 255
        expected = expected / (image.shape[axis] - 1)
        np.testing.assert_allclose(small.mean(axis=1 - axis), expected, atol=2.5)


@pytest.mark.parametrize(("stated", "seen"), [("limited", [0, 0, 0, 255, 255]), ("full", None)])
def test_what_lies_beyond_the_limited_range_is_cut_off(stated: str, seen: list[int] | None) -> None:
    for place, value in enumerate((0, 8, 16, 235, 255)):
        stored = np.full((40 * 3 // 2, 64), 128, np.uint8)
        stored[:40] = value
        pixel_format = "yuv420p" if stated == "limited" else "yuvj420p"
        picture = VideoFrame.from_ndarray(stored, format=pixel_format)
        small = PictureMaker((64, 40)).small(picture, Orientation(), Fraction(1))
        assert small is not None
        assert (small == (value if seen is None else seen[place])).all()


def test_places_in_a_palette_are_no_brightness() -> None:
    assert (
        PictureMaker((64, 40)).small(VideoFrame(64, 40, "pal8"), Orientation(), Fraction(1)) is None
    )


@pytest.mark.parametrize("shape", [(2, 4000, 3), (4000, 2, 3), (1, 1, 3)])
def test_a_picture_that_is_a_line_has_a_small_one(shape: tuple[int, int, int]) -> None:
    small = Frame(0, 0.0, np.full(shape, 90, np.uint8)).small
    assert (small == 90).all() and max(small.shape) <= SIZE


def test_a_small_picture_keeps_its_size() -> None:
    image = np.full((40, 30, 3), 77, np.uint8)
    frame = Frame(0, 0.0, image)
    np.testing.assert_array_equal(frame.small, np.full((40, 30), 77))
    assert frame.small is frame.small
