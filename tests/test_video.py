"""Decoding: every frame, its number, its time, its way up, its shape and its colours."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.frame import VideoFrame

from dance2pose.errors import UsageError, VideoError
from dance2pose.poses import Frame
from dance2pose.video import FrameReader, open_video
from dance2pose.video import reader as reader_module
from video_making import (
    LOSSLESS,
    is_upright,
    make_video,
    numbered,
    numbered_video,
    read_number,
)

QUIET_X265 = {"x265-params": "log-level=none:keyint=24"}
INTERLACED = {"flags": "+ilme+ildct"}


def read(path: Path | str, **options: Any) -> tuple[list[Frame], FrameReader]:
    with open_video(path, **options) as frames:
        return list(frames), frames


CODECS: dict[str, dict[str, Any]] = {
    "h264.mp4": {},
    "h264.ts": {},
    "h264.avi": {},
    "hevc_10bit.mp4": dict(codec="libx265", pixel_format="yuv420p10le", options=QUIET_X265),
    "vp8.webm": dict(codec="libvpx"),
    "vp9.webm": dict(codec="libvpx-vp9", options={"deadline": "realtime", "cpu-used": "8"}),
    "av1.mp4": dict(codec="libsvtav1", options={"preset": "12"}),
    "ffv1_422_10bit.mkv": dict(codec="ffv1", pixel_format="yuv422p10le"),
    "ffv1_rgb.mkv": dict(codec="ffv1", pixel_format="bgr0"),
    "prores.mov": dict(codec="prores_ks", pixel_format="yuv422p10le"),
    "dv.dv": dict(codec="dvvideo", container_format="dv", width=720, height=576),
    "dv.avi": dict(codec="dvvideo", width=720, height=576),
    "mpeg2.mpg": dict(codec="mpeg2video"),
    "mpeg2.mkv": dict(codec="mpeg2video", options={"bf": "2"}),
    "mpeg4_b_frames.avi": dict(codec="mpeg4", options={"bf": "2"}),
    "mjpeg.avi": dict(codec="mjpeg", pixel_format="yuvj420p"),
    "huffyuv.avi": dict(codec="huffyuv", pixel_format="yuv422p"),
    "uyvy.mov": dict(codec="rawvideo", pixel_format="uyvy422"),
    "odd_size.mp4": dict(pixel_format="yuv444p", width=131, height=97),
}


@pytest.mark.parametrize("name", CODECS)
def test_every_codec_gives_every_frame_in_order_at_its_time(name: str, tmp_path: Path) -> None:
    path = numbered_video(tmp_path / name, count=12, **CODECS[name])
    frames, video = read(path)
    assert [read_number(frame.image) for frame in frames] == list(range(12))
    assert [frame.index for frame in frames] == list(range(12))
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(12) / 25, atol=1e-3)
    assert all(is_upright(frame.image) for frame in frames)
    assert {frame.image.shape for frame in frames} == {(video.info.height, video.info.width, 3)}
    assert video.warnings == [] and not video.damaged
    assert video.frames_read == 12
    assert video.info.frame_count in (12, None)
    assert video.info.frame_rate == pytest.approx(25)


def test_variable_frame_rate_keeps_each_frames_own_time(tmp_path: Path) -> None:
    times = [0, 40, 50, 200, 1000, 1001, 1200, 1300, 1400, 2000, 2100, 2101]
    frames, video = read(numbered_video(tmp_path / "vfr.mp4", times_ms=times))
    np.testing.assert_allclose([1000 * frame.time_s for frame in frames], times, atol=0.1)
    assert [read_number(frame.image) for frame in frames] == list(range(12))
    assert video.warnings == []


def test_a_stream_that_starts_late_counts_from_its_own_start(tmp_path: Path) -> None:
    times = [7000 + 40 * number for number in range(12)]
    frames, video = read(numbered_video(tmp_path / "late.mkv", times_ms=times))
    assert frames[0].time_s == 0
    assert frames[-1].time_s == pytest.approx(0.44)
    assert video.info.start_time_s == pytest.approx(7)


def test_no_timestamps_are_derived_from_the_rate_and_said(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "raw.h264", container_format="h264")
    frames, video = read(path)
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(12) / 25)
    assert any("no frame carries a timestamp" in line for line in video.warnings)
    assert not video.damaged


def test_no_timestamps_take_the_codecs_own_rate(tmp_path: Path) -> None:
    """30 pictures a second stand in the H.264 stream; the container would say 25."""
    path = numbered_video(tmp_path / "raw.h264", container_format="h264", rate=30)
    frames, _ = read(path)
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(12) / 30)


def test_joined_recordings_run_on(tmp_path: Path) -> None:
    """Two programme streams one after the other: the second one's clock begins again."""
    part = numbered_video(tmp_path / "part.mpg", codec="mpeg2video").read_bytes()
    (tmp_path / "joined.mpg").write_bytes(part + part)
    frames, video = read(tmp_path / "joined.mpg")
    np.testing.assert_allclose([f.time_s for f in frames], np.arange(24) / 25, atol=1e-3)
    assert any("begin again at 1 place" in line for line in video.warnings)


def stored(upright: np.ndarray, degrees: int, hflip: bool, vflip: bool) -> np.ndarray:
    """What a camera stores so that turning it counter-clockwise, then mirroring, is `upright`."""
    if vflip:
        upright = upright[::-1]
    if hflip:
        upright = upright[:, ::-1]
    return np.rot90(upright, -degrees // 90)


@pytest.mark.parametrize("hflip,vflip", [(False, False), (True, False), (False, True)])
@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_rotation_metadata_is_applied_once(
    degrees: int, hflip: bool, vflip: bool, tmp_path: Path
) -> None:
    upright = [numbered(number, 160, 96) for number in range(3)]
    path = make_video(
        tmp_path / "turned.mp4",
        [stored(image, degrees, hflip, vflip) for image in upright],
        turned=(degrees, hflip, vflip),
        pixel_format="yuv444p",
        options=LOSSLESS,
    )
    frames, video = read(path)
    assert video.info.size == (160, 96)
    assert (video.info.stored_width, video.info.stored_height) == (
        (96, 160) if degrees in (90, -90) else (160, 96)
    )
    for image, frame in zip(upright, frames, strict=True):
        assert np.abs(image.astype(int) - frame.image).max() <= 6
    if not (hflip or vflip):
        assert video.info.rotation_degrees == -degrees % 360
    assert video.info.mirrored == (hflip != vflip)


@pytest.mark.parametrize(
    "aspect,size",
    [
        (Fraction(16, 15), (768, 576)),
        (Fraction(64, 45), (1024, 576)),
        (Fraction(8, 9), (720, 648)),
        (Fraction(1, 90), (720, 576)),  # cannot be true
    ],
)
def test_sample_aspect_is_undone_without_losing_lines(
    aspect: Fraction, size: tuple[int, int], tmp_path: Path
) -> None:
    path = numbered_video(tmp_path / "pal.mp4", 3, width=720, height=576, sample_aspect=aspect)
    frames, video = read(path)
    assert video.info.size == size
    assert frames[1].image.shape == (size[1], size[0], 3)
    assert [read_number(frame.image) for frame in frames] == [0, 1, 2]
    assert min(video.info.width / 720, video.info.height / 576) >= 1


def test_sample_aspect_goes_with_the_turn(tmp_path: Path) -> None:
    path = numbered_video(
        tmp_path / "t.mp4", 2, turned=(90, False, False), sample_aspect=Fraction(2), width=96
    )
    assert read(path)[1].info.size == (96, 192)


def test_tape_mpeg2_interlaced_with_wide_pixels(tmp_path: Path) -> None:
    path = numbered_video(
        tmp_path / "tape.mpg",
        8,
        codec="mpeg2video",
        width=720,
        height=576,
        sample_aspect=Fraction(16, 15),
        fields="tff",
        options=INTERLACED,
    )
    frames, video = read(path)
    assert video.info.size == (768, 576)
    assert video.info.sample_aspect_ratio == Fraction(16, 15)
    assert video.info.interlaced and video.deinterlaced
    assert [read_number(frame.image) for frame in frames] == list(range(8))


MATRICES = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le"])
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize(
    "stated,size,effective",
    [
        (1, (64, 48), 1),
        (5, (1280, 720), 5),
        (6, (64, 48), 6),
        (9, (64, 48), 9),
        (2, (64, 48), 5),  # unstated: by the size
        (2, (1280, 720), 1),
    ],
)
def test_colours_follow_the_stated_matrix_and_range(
    stated: int,
    size: tuple[int, int],
    effective: int,
    full: bool,
    pixel_format: str,
    tmp_path: Path,
) -> None:
    """Against the equations of BT.601, BT.709 and BT.2020."""
    luma, blue_difference, red_difference = 120, 90, 190
    ten_bit = pixel_format.endswith("10le")
    frame = VideoFrame(*size, pixel_format)
    for plane, value in zip(frame.planes, (luma, blue_difference, red_difference), strict=True):
        kind, scale = (np.uint16, 4) if ten_bit else (np.uint8, 1)
        samples = np.full(plane.buffer_size // np.dtype(kind).itemsize, value * scale, dtype=kind)
        plane.update(samples.tobytes())
    frame.pts, frame.time_base = 0, Fraction(1, 25)
    frame.colorspace, frame.color_range = stated, 2 if full else 1
    path = tmp_path / "colour.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height = size
        stream.pix_fmt = pixel_format
        stream.codec_context.colorspace = stated
        stream.codec_context.color_range = 2 if full else 1
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))

    red_weight, blue_weight = MATRICES[effective]
    if full:
        y, cb, cr = luma / 255, (blue_difference - 128) / 255, (red_difference - 128) / 255
    else:
        y, cb, cr = (luma - 16) / 219, (blue_difference - 128) / 224, (red_difference - 128) / 224
    red = y + 2 * (1 - red_weight) * cr
    blue = y + 2 * (1 - blue_weight) * cb
    green = (y - red_weight * red - blue_weight * blue) / (1 - red_weight - blue_weight)
    expected = 255 * np.clip([blue, green, red], 0, 1)

    frames, video = read(path)
    np.testing.assert_allclose(frames[0].image[24, 32], expected, atol=2.5)
    assert video.info.full_range == full


@pytest.mark.parametrize("every", [1, 3])
def test_start_end_every(every: int, tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 50)
    frames, video = read(path, start_s=1.0, end_s=1.5, every=every)
    expected = list(range(25, 38, every))
    assert [frame.index for frame in frames] == expected
    assert [read_number(frame.image) for frame in frames] == expected
    assert video.expected_frames == pytest.approx(len(expected), abs=1)
    assert video.warnings == []


X264_OPEN = {"x264-params": "open-gop=1:bframes=3:b-pyramid=normal:keyint=24:scenecut=0"}
LONG: dict[str, tuple[dict[str, Any], bool]] = {
    "h264.mp4": (dict(options={"g": "24"}), True),
    "open_gop.mp4": (dict(options=X264_OPEN), True),
    "open_gop.mkv": (dict(options=X264_OPEN), True),
    "hevc.mp4": (dict(codec="libx265", options=QUIET_X265), True),
    "mpeg2.mkv": (dict(codec="mpeg2video", options={"g": "12", "bf": "2"}), True),
    "av1.mp4": (dict(codec="libsvtav1", options={"preset": "12", "g": "24"}), True),
    "mjpeg.avi": (dict(codec="mjpeg", pixel_format="yuvj420p"), True),
    "interlaced.mkv": (
        dict(codec="ffv1", pixel_format="yuv422p", fields="tff", options=INTERLACED),
        True,
    ),
    "variable.mp4": (
        dict(options={"g": "24"}, times_ms=[40 * n + (n * n) % 39 for n in range(250)]),
        True,
    ),
    # Packets that do not tell: decoded from the beginning.
    "h264.ts": (dict(options={"g": "24"}), False),
    "vp8.webm": (dict(codec="libvpx", options={"g": "24"}), False),
    "h264.avi": (dict(options={"g": "24"}), False),
}


@pytest.mark.parametrize("name", LONG)
def test_starting_late_gives_the_same_frames_as_reading_through(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options, sought = LONG[name]
    path = numbered_video(tmp_path / name, 250, **options)
    with open_video(path, start_s=6.03, end_s=9.0) as video:
        first_decoded, frames = next(video._pictures), list(video)
        assert video.warnings == [] and not video.damaged
    assert (first_decoded[0] > 0) == sought
    monkeypatch.setattr(reader_module, "LEAST_SKIP_S", float("inf"))
    through, _ = read(path, start_s=6.03, end_s=9.0)
    assert [f.index for f in frames] == [f.index for f in through]
    assert [f.time_s for f in frames] == [f.time_s for f in through]
    assert [read_number(f.image) for f in frames] == [f.index for f in frames]
    for one, other in zip(frames, through, strict=True):
        np.testing.assert_array_equal(one.image, other.image)


def test_a_change_of_size_keeps_one_coordinate_system(tmp_path: Path) -> None:
    one = numbered_video(tmp_path / "1.ts", 12).read_bytes()
    other = numbered_video(tmp_path / "2.ts", 12, width=192, height=192).read_bytes()
    (tmp_path / "joined.ts").write_bytes(one + other)
    frames, video = read(tmp_path / "joined.ts")
    assert {frame.image.shape for frame in frames} == {(96, 128, 3)}
    last = frames[-1].image
    assert (last[:, :15] == 0).all() and (last[:, 113:] == 0).all()
    assert read_number(last[:, 16:112]) == 11
    assert any("black borders" in line for line in video.warnings)


def test_the_names_of_files_may_be_anything(tmp_path: Path) -> None:
    data = numbered_video(tmp_path / "a.mp4", 2).read_bytes()
    folder = tmp_path
    while len(str(folder)) < 3600:
        folder /= "x" * 200
    folder.mkdir(parents=True)
    for path in (
        tmp_path / "Tänzerin 舞踊 – it's 100% [1].mp4",
        tmp_path / "concat:a|b.mp4",
        tmp_path / "http:",
        Path(str(tmp_path) + "/t\udce4nzer.mp4"),  # a name in Latin-1
        folder / "long.mp4",
    ):
        path.write_bytes(data)
        frames, video = read(path)
        assert len(frames) == 2 and video.info.path == path
        assert video.info.size_bytes == len(data)


def test_an_edit_list_that_hides_frames_is_no_loss(tmp_path: Path) -> None:
    """Negative times make the muxer write an edit list; the hidden frames are not shown."""
    times = [40 * number - 200 for number in range(12)]
    frames, video = read(numbered_video(tmp_path / "cut.mp4", times_ms=times))
    assert not video.damaged, video.warnings
    assert [frame.index for frame in frames] == list(range(len(frames)))
    assert (np.diff([frame.time_s for frame in frames]) > 0.039).all()


@pytest.mark.parametrize(
    "options",
    [dict(start_s=-1), dict(start_s=float("nan")), dict(start_s=3, end_s=2), dict(every=0)],
)
def test_ranges_that_cannot_be(options: dict[str, Any], tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 2)
    with pytest.raises(UsageError):
        open_video(path, **options)


def test_a_start_after_the_end_is_an_error(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 12)
    with pytest.raises(VideoError, match=r"no frame from 60 s on; the last one read is at 0\.44 s"):
        read(path, start_s=60)


@pytest.mark.shared
@pytest.mark.parametrize(
    "name,count,size,rate",
    [
        ("contemporary_dance", 545, (384, 496), 30),
        ("two_walkers", 230, (1768, 994), 30),
        ("balance_cam03", 100, (1088, 1920), 60),
        ("balance_cam02", 100, (1080, 1920), 60),
    ],
)
def test_real_videos(shared: Path, name: str, count: int, size: tuple[int, int], rate: int) -> None:
    with open_video(shared / "videos" / f"{name}.mp4") as video:
        times = [frame.time_s for frame in video]
    np.testing.assert_allclose(times, np.arange(count) / rate, atol=1e-6)
    assert video.info.size == size and video.info.frame_count == count
    assert not video.info.interlaced and not video.deinterlaced
    assert video.warnings == [] and not video.damaged
