"""Loss and length on one clock: edits, late starts, large timestamps and dropped frames are no
damage; a jump of the timestamps is a hole in time."""

from __future__ import annotations

import struct
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.provenance import describe_video
from dance2pose.video import FrameReader, open_video
from video_making import (
    TrackPlan,
    as_frame,
    make_tracks,
    numbered,
    numbered_video,
    read_number,
    show_only,
)


def read(path: Path) -> tuple[list[int], list[float], FrameReader]:
    """Numbers and times of all frames; the reader, for its account."""
    with open_video(path) as video:
        frames = [(read_number(frame.image), frame.time_s) for frame in video]
    return [number for number, _ in frames], [time for _, time in frames], video


def test_an_edit_list_that_hides_the_end(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 120, options={"g": "12"})
    numbers, times, video = read(show_only(path, 2.4))
    assert numbers == list(range(60))
    assert (video.info.frame_count, video.info.duration_s) == (60, pytest.approx(2.4))
    assert video.info.frame_rate == pytest.approx(25)
    assert times[-1] == pytest.approx(59 / 25)
    assert not video.damaged and video.warnings == []
    assert video.expected_frames == 60


def test_an_edit_list_and_a_file_cut_short(tmp_path: Path) -> None:
    """What is hidden is not missing; what is missing is said."""
    path = numbered_video(
        tmp_path / "a.mp4", 120, options={"g": "12"}, container_options={"movflags": "faststart"}
    )
    data = show_only(path, 2.4).read_bytes()
    start = data.index(b"mdat")
    path.write_bytes(data[: start + (len(data) - start) // 3])
    numbers, _, video = read(path)
    assert numbers == list(range(len(numbers))) and 20 < len(numbers) < 50
    assert video.damaged
    lost = int(video.warnings[0].split(" of ")[0])
    # Decoding may hold back a few pictures that the edit hides after the last one shown.
    assert 60 - len(numbers) <= lost <= 60 - len(numbers) + 16


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4", "a.ts"])
def test_a_video_that_starts_after_its_sound(name: str, tmp_path: Path) -> None:
    path = make_tracks(tmp_path / name, [TrackPlan(30, start_ms=800)], sound_s=4)
    numbers, times, video = read(path)
    assert numbers == list(range(30))
    assert times == pytest.approx([number / 25 for number in range(30)], abs=1e-3)
    assert not video.damaged and video.warnings == []
    # Sound encoders begin a little before the first sample that is heard.
    assert video.info.file_offset_s == pytest.approx(0.8, abs=0.14)
    if name != "a.ts":
        assert video.info.duration_s == pytest.approx(1.2, abs=0.05)
    details = describe_video(video.info, frames_read=30).details
    assert details["starts after the file's start s"] == video.info.file_offset_s


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4", "a.ts"])
def test_timestamps_that_begin_at_a_thousand_seconds(name: str, tmp_path: Path) -> None:
    """As -copyts leaves them."""
    path = make_tracks(tmp_path / name, [TrackPlan(30, start_ms=1_000_000)])
    numbers, times, video = read(path)
    assert numbers == list(range(30))
    assert times == pytest.approx([number / 25 for number in range(30)], abs=1e-3)
    assert not video.damaged and video.warnings == []
    assert video.info.file_offset_s == pytest.approx(0, abs=0.01)
    assert video.expected_frames in (29, 30, 31)


def test_the_length_that_mkvmerge_tags_is_no_time(tmp_path: Path) -> None:
    """The same tag from two programs: an end on the file's clock, or a length."""
    path = make_tracks(
        tmp_path / "a.mkv",
        [TrackPlan(30, start_ms=800)],
        sound_s=3,
        metadata={"_STATISTICS_WRITING_APP": "mkvmerge v80"},
    )
    data = path.read_bytes()
    assert data.count(b"00:00:02.000000000") == 1  # FFmpeg's own, of the end of the video
    path.write_bytes(data.replace(b"00:00:02.000000000", b"00:00:01.200000000"))
    numbers, _, video = read(path)
    assert numbers == list(range(30)) and not video.damaged
    assert video.info.duration_s == pytest.approx(1.2)


def test_dropped_frames_of_an_avi_are_no_loss(tmp_path: Path) -> None:
    """Capture programs write chunks without data where nothing new came."""
    path = tmp_path / "a.avi"
    kept = [number for number in range(20) if number not in (5, 6, 11)]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuvj420p"
        for number in range(20):
            frame = as_frame(numbered(number), "yuvj420p")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            packets = stream.encode(frame)
            if number in kept:
                container.mux(packets)
    assert path.read_bytes().count(b"00dc\0\0\0\0") >= 3
    numbers, times, video = read(path)
    assert numbers == kept
    assert times == pytest.approx([number / 25 for number in kept])
    assert not video.damaged


def test_a_picture_of_no_bytes_in_an_mp4_does_not_end_it(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 20, codec="mjpeg", pixel_format="yuvj420p")
    data = bytearray(path.read_bytes())
    sizes = data.index(b"stsz") + 12
    count = struct.unpack(">I", data[sizes : sizes + 4])[0]
    assert count == 20
    last = sizes + 4 * count
    data[last : last + 4] = bytes(4)
    path.write_bytes(data)
    numbers, _, video = read(path)
    assert numbers == list(range(19)) and not video.damaged


@given(
    start_ms=st.integers(0, 40_000_000),
    sound=st.booleans(),
    count=st.integers(2, 20),
    name=st.sampled_from(["a.mkv", "a.mov", "a.ts"]),
)
@settings(max_examples=20, deadline=None)
def test_wherever_the_timestamps_begin_the_file_is_whole(
    start_ms: int, sound: bool, count: int, name: str
) -> None:
    start_ms = min(start_ms, 3000) if sound else start_ms
    # FFmpeg, ffprobe too, takes a transport stream of nine or ten packets for no video at all.
    count = max(count, 4) if name == "a.ts" else count
    with TemporaryDirectory() as folder:
        path = make_tracks(
            Path(folder) / name,
            [TrackPlan(count, start_ms=start_ms)],
            sound_s=2 if sound else None,
            codec="libx264" if name == "a.ts" else "mjpeg",
            pixel_format="yuv420p" if name == "a.ts" else "yuvj420p",
        )
        numbers, times, video = read(path)
    assert numbers == list(range(count))
    assert times == pytest.approx([number / 25 for number in range(count)], abs=2e-3)
    assert not video.damaged and video.warnings == []
    expected_s = start_ms / 1000 if sound else 0
    assert video.info.file_offset_s == pytest.approx(expected_s, abs=0.14)


# Holes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.mkv", "a.mp4"])
def test_a_jump_of_the_timestamps_is_a_hole_in_time(name: str, tmp_path: Path) -> None:
    times_ms = [40 * number + (7000 if number >= 60 else 0) for number in range(120)]
    _, times, video = read(numbered_video(tmp_path / name, 120, times_ms=times_ms))
    assert times == pytest.approx([ms / 1000 for ms in times_ms])
    assert not video.damaged
    assert video.warnings == ["frames seem to be missing at 1 places, 7.00 s in all"]


def test_frames_that_are_missing_leave_their_time(tmp_path: Path) -> None:
    kept = [number for number in range(100) if number not in (20, 21, 22, 70)]
    path = numbered_video(tmp_path / "a.mkv", len(kept), times_ms=[40 * n for n in kept])
    with open_video(path) as video:
        times = np.array([frame.time_s for frame in video])
    np.testing.assert_allclose(times, np.array(kept) / 25, atol=1e-3)
    assert video.warnings == ["frames seem to be missing at 2 places, 0.16 s in all"]


def test_recordings_joined_end_to_end_are_not_damaged(tmp_path: Path) -> None:
    parts = [numbered_video(tmp_path / f"{part}.ts", 20).read_bytes() for part in range(2)]
    (tmp_path / "a.ts").write_bytes(b"".join(parts))
    numbers, times, video = read(tmp_path / "a.ts")
    assert numbers == [*range(20), *range(20)]
    assert times == pytest.approx([number / 25 for number in range(40)], abs=1e-3)
    assert not video.damaged
    assert len(video.warnings) == 1 and "begin again at 1 places" in video.warnings[0]


def test_pictures_that_build_upon_what_was_cut_off_are_no_damage(tmp_path: Path) -> None:
    """HEVC cut at a key picture before which pictures are shown that refer to what was cut off."""
    options = {
        "preset": "ultrafast",
        "x265-params": "open-gop=1:keyint=20:bframes=3:log-level=none",
    }
    whole = numbered_video(tmp_path / "whole.mp4", 60, codec="libx265", options=options)
    path = tmp_path / "cut.mkv"
    with av.open(str(whole)) as source, av.open(str(path), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        packets = [p for p in source.demux(video=0) if p.size]
        start = next(i for i, p in enumerate(packets) if i > 10 and p.is_keyframe)
        for packet in packets[start:]:
            packet.stream = stream
            target.mux(packet)
    numbers, _, video = read(path)
    assert numbers == list(range(20, 60)) and not video.damaged
    assert ["cannot be shown" in line for line in video.warnings] == [True]


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "count", "rate", "length_s", "offset_s"),
    [
        ("edit_list_hides_the_end.mp4", 60, 30, 2.0, 0.0),
        ("video_starts_late.mkv", 38, 30, 1.366, 0.823),
    ],
)
def test_real_files_are_whole(
    name: str, count: int, rate: float, length_s: float, offset_s: float, shared: Path
) -> None:
    with open_video(shared / "cases" / name) as video:
        assert len(list(video)) == count
    info = video.info
    assert not video.damaged and not any("missing or could" in line for line in video.warnings)
    assert (info.frame_rate, info.duration_s) == (pytest.approx(rate), pytest.approx(length_s))
    assert info.file_offset_s == pytest.approx(offset_s)
