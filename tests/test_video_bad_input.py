"""What is no video is refused in one line that names the file."""

from __future__ import annotations

import os
import struct
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from dance2pose.errors import VideoError
from dance2pose.video import open_video, source
from video_making import make_sound, make_video, numbered_video, scene


def refused(path: Path, *parts: str) -> None:
    with pytest.raises(VideoError) as caught, open_video(path) as video:
        list(video)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message
    for part in parts:
        assert part in message, message


def test_missing(tmp_path: Path) -> None:
    refused(tmp_path / "none.mp4", "no such file")
    refused(tmp_path / ("x" * 300), "cannot be read")


def test_folder(tmp_path: Path) -> None:
    refused(tmp_path, "is a folder")


def test_empty(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").touch()
    refused(tmp_path / "a.mp4", "is empty")


def test_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mp4")
    refused(tmp_path / "a.mp4", "pipe")


def test_text_and_noise(tmp_path: Path) -> None:
    for name in ("a.mp4", "a.mkv", "a.txt", "a"):
        (tmp_path / name).write_text("Swan Lake, act two\n" * 50)
        refused(tmp_path / name, "not a video")
    (tmp_path / "b.mp4").write_bytes(np.random.default_rng(0).bytes(100_000))
    refused(tmp_path / "b.mp4", "not a video")


def test_lists_of_other_files_are_not_followed(tmp_path: Path) -> None:
    numbered_video(tmp_path / "real.ts", 2)
    playlist = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nreal.ts\n#EXT-X-ENDLIST\n"
    for name in ("a.m3u8", "a.mp4"):
        (tmp_path / name).write_text(playlist)
        refused(tmp_path / name, "not a video")
    (tmp_path / "b.mp4").write_text("ffconcat version 1.0\nfile real.ts\n")
    refused(tmp_path / "b.mp4", "not a video")


def test_sound_alone(tmp_path: Path) -> None:
    refused(make_sound(tmp_path / "a.m4a"), "holds no video, only: audio")


def test_no_frames(tmp_path: Path) -> None:
    """An MP4 with a stream of one frame, whose frame is gone."""
    data = numbered_video(tmp_path / "a.mp4", 1).read_bytes()
    start = data.index(b"mdat") + 4
    end = data.index(b"moov") - 4
    (tmp_path / "a.mp4").write_bytes(data[:start] + bytes(end - start) + data[end:])
    refused(tmp_path / "a.mp4", "no frame that can be decoded")
    numbered_video(tmp_path / "b.mp4", 0)
    refused(tmp_path / "b.mp4")


def test_one_frame_is_a_video(tmp_path: Path) -> None:
    with open_video(numbered_video(tmp_path / "a.mp4", 1)) as video:
        frames = list(video)
    assert [frame.index for frame in frames] == [0] and frames[0].time_s == 0


def test_unreadable(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 2)
    path.chmod(0)
    if os.geteuid() != 0:
        refused(path, "may not be read")
        return
    os.seteuid(65534)  # root may read everything; be nobody for a moment
    try:
        refused(path, "may not be read")
    finally:
        os.seteuid(0)


@pytest.mark.parametrize(
    "name,codec,pixel_format",
    [
        ("a.mkv", "ffv1", "yuv422p"),
        ("a.avi", "mjpeg", "yuvj420p"),
        ("a.mov", "rawvideo", "uyvy422"),
    ],
)
def test_absurd_sizes_are_refused(
    name: str, codec: str, pixel_format: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the limit lowered under an ordinary picture's size; the test needs no big one."""
    path = numbered_video(
        tmp_path / name, 2, codec=codec, pixel_format=pixel_format, width=640, height=480
    )
    monkeypatch.setattr(source, "MAX_PIXELS", 640 * 480 - 1)
    refused(path, "px")


def test_a_header_that_lies_about_the_size(tmp_path: Path) -> None:
    """60000 x 60000 px in the AVI header and in every JPEG: 10 GB if it were believed."""
    data = bytearray(
        numbered_video(tmp_path / "a.avi", 2, codec="mjpeg", pixel_format="yuvj420p").read_bytes()
    )
    start = -1
    while (start := data.find(b"\xff\xc0\x00\x11\x08", start + 1)) >= 0:
        data[start + 5 : start + 9] = (60000).to_bytes(2, "big") * 2
    header = data.index(b"strf") + 12
    data[header : header + 8] = (60000).to_bytes(4, "little") * 2
    (tmp_path / "a.avi").write_bytes(data)
    refused(tmp_path / "a.avi", "px")


def test_pictures_that_carry_exif_are_read(tmp_path: Path) -> None:
    plain = make_video(
        tmp_path / "plain.avi", [scene(1)] * 5, codec="mjpeg", pixel_format="yuvj420p"
    )
    # Orientation 1, as still cameras write it into each picture of a film.
    tag = struct.pack("<HHII", 0x0112, 3, 1, 1)
    exif = b"Exif\0\0II*\0\x08\0\0\0" + struct.pack("<H", 1) + tag + bytes(4)
    segment = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
    path = tmp_path / "exif.avi"
    with av.open(str(plain)) as source, av.open(str(path), "w") as copy:
        stream = copy.add_stream_from_template(source.streams.video[0])
        for number, packet in enumerate(p for p in source.demux(video=0) if p.size):
            data = bytes(packet)
            tagged = av.Packet(data[:2] + segment + data[2:])
            tagged.pts = tagged.dts = number
            tagged.time_base, tagged.stream, tagged.is_keyframe = Fraction(1, 25), stream, True
            copy.mux(tagged)
    with open_video(path) as video, open_video(plain) as other:
        for frame, expected in zip(video, other, strict=True):
            np.testing.assert_array_equal(frame.image, expected.image)
