"""Damaged files: what can be decoded is, and every loss is counted and said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dance2pose.errors import VideoError
from dance2pose.video import FrameReader, open_video
from dance2pose.video.ffv1 import Checksums
from video_making import make_video, scene, with_dancer

COUNT = 60
FAST_START = {"movflags": "faststart"}

FORMATS: dict[str, dict[str, Any]] = {
    "h264.mp4": dict(container_options=FAST_START, options={"g": "12"}),
    "h264.mkv": dict(options={"g": "12"}),
    "h264.ts": dict(options={"g": "12"}),
    "ffv1.mkv": dict(
        codec="ffv1",
        pixel_format="yuv422p",
        options={"level": "3", "slicecrc": "1", "slices": "4"},
    ),
    "mpeg2.mpg": dict(codec="mpeg2video", bit_rate=2_000_000),
    "mjpeg.avi": dict(codec="mjpeg", pixel_format="yuvj420p"),
    "prores.mov": dict(codec="prores_ks", pixel_format="yuv422p10le", container_options=FAST_START),
    "av1.mp4": dict(codec="libsvtav1", options={"preset": "12"}, container_options=FAST_START),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], bytes]:
    """The bytes of a sound video in a format, made once."""
    folder = tmp_path_factory.mktemp("whole")
    background = scene(1)

    def get(name: str) -> bytes:
        if not (folder / name).exists():
            pictures = (with_dancer(background, number / 25) for number in range(COUNT))
            make_video(folder / name, pictures, **FORMATS[name])
        return (folder / name).read_bytes()

    return get


def read(path: Path) -> tuple[list[int], FrameReader]:
    with open_video(path) as video:
        times = [frame.time_s for frame in video]
    assert (np.diff(times) > 0).all()
    return [round(25 * time) for time in times], video


@pytest.mark.parametrize("name", FORMATS)
def test_a_sound_file_has_no_losses(
    name: str, whole: Callable[[str], bytes], tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(whole(name))
    frames, video = read(tmp_path / name)
    assert frames == list(range(COUNT))
    assert not video.damaged and video.warnings == []


@pytest.mark.parametrize("name", FORMATS)
def test_a_truncated_file_gives_what_is_left(
    name: str, whole: Callable[[str], bytes], tmp_path: Path
) -> None:
    data = whole(name)
    (tmp_path / name).write_bytes(data[: len(data) * 6 // 10])
    frames, video = read(tmp_path / name)
    assert 20 < len(frames) < COUNT - 10
    assert frames == list(range(len(frames)))
    assert video.damaged and video.warnings
    if video.info.frame_count:
        lost = f"{COUNT - len(frames)} of {COUNT} frames are missing"
        assert any(lost in line for line in video.warnings), video.warnings
    elif name.endswith(".mkv"):
        assert any("its end is missing" in line for line in video.warnings)


@pytest.mark.parametrize("name", FORMATS)
def test_a_hole_in_the_file(name: str, whole: Callable[[str], bytes], tmp_path: Path) -> None:
    data = bytearray(whole(name))
    middle = len(data) // 2
    data[middle : middle + len(data) // 20] = bytes(len(data) // 20)
    (tmp_path / name).write_bytes(data)
    frames, video = read(tmp_path / name)
    assert 0.6 * COUNT < len(frames) <= COUNT
    assert video.damaged and video.warnings
    assert frames[0] == 0


@pytest.mark.parametrize("name", ["h264.mp4", "mpeg2.mpg", "ffv1.mkv", "prores.mov"])
def test_flipped_bits_are_heard_of(
    name: str, whole: Callable[[str], bytes], tmp_path: Path
) -> None:
    data = bytearray(whole(name))
    random = np.random.default_rng(5)
    for position in random.integers(len(data) // 4, len(data) * 9 // 10, 40):
        data[position] ^= 1 << int(random.integers(8))
    (tmp_path / name).write_bytes(data)
    frames, video = read(tmp_path / name)
    assert len(frames) > 0.8 * COUNT
    assert video.damaged and video.warnings


def test_one_flipped_bit_in_ffv1_fails_its_checksum(
    whole: Callable[[str], bytes], tmp_path: Path
) -> None:
    """The decoder covers the damage without a word; the archive must know."""
    data = bytearray(whole("ffv1.mkv"))
    data[len(data) // 2] ^= 1
    (tmp_path / "a.mkv").write_bytes(data)
    frames, video = read(tmp_path / "a.mkv")
    assert len(frames) == COUNT
    assert video.warnings == [f"the checksums of 1 of {COUNT} frames fail"]


def test_ffv1_without_checksums_is_not_accused(tmp_path: Path) -> None:
    path = make_video(
        tmp_path / "old.mkv",
        [scene(seed) for seed in range(3)],
        codec="ffv1",
        pixel_format="yuv420p",
        options={"level": "1"},
    )
    _, video = read(path)
    assert not video.damaged and video.warnings == []


def test_checksums_of_nonsense() -> None:
    sums = Checksums()
    for packet in (b"", b"\0", bytes(7), bytes(8), b"\xff" * 100):
        sums.check(packet)
    assert sums.failed == 0


def test_an_mp4_without_its_index_says_so(
    tmp_path: Path,
) -> None:
    pictures = [scene(seed) for seed in range(12)]
    data = make_video(tmp_path / "a.mp4", pictures).read_bytes()
    (tmp_path / "a.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(VideoError, match="index \\(moov\\) is missing"):
        open_video(tmp_path / "a.mp4")


@pytest.mark.parametrize("seed", range(12))
def test_random_damage_never_ends_in_another_error(
    seed: int, whole: Callable[[str], bytes], tmp_path: Path
) -> None:
    """Headers too: overwritten, cut, or filled with noise, a file is read or refused."""
    random = np.random.default_rng(seed)
    name = list(FORMATS)[seed % len(FORMATS)]
    data = bytearray(whole(name))
    for _ in range(6):
        start = int(
            random.integers(0, min(len(data), 4000)) if seed % 2 else random.integers(len(data))
        )
        data[start : start + 20] = random.bytes(20)
    (tmp_path / name).write_bytes(data)
    try:
        with open_video(tmp_path / name) as video:
            assert all(frame.image.ndim == 3 for frame in video)
    except VideoError as error:
        assert str(tmp_path / name) in str(error)
