"""Which picture a recording gets, and that it shows each frame at its own time."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from dance2pose.errors import UsageError
from dance2pose.recording import picture as picture_module
from dance2pose.recording import pieces as pieces_module
from dance2pose.recording.picture import choose_picture, ffmpeg_plays
from dance2pose.recording.pieces import References, nearest, pieces
from dance2pose.recording.writer import RecordingWriter
from dance2pose.video import VideoInfo, open_video
from recording_making import Recording, make_provenance, timeline_of
from video_making import make_video, numbered, numbered_video, woven

TIMES_MS = [0, 40, 80, 160, 200, 210, 300, 340, 500, 540, 600, 720]
# Else x264 writes the clock's tick, a millisecond, into the stream as its frame rate.
STEADY = {"x264-params": "force-cfr=1"}
OPEN = "force-cfr=1:open-gop=1"


@pytest.fixture(autouse=True)
def with_ffmpeg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture_module, "ffmpeg_plays", lambda: True)


def info_of(path: Path) -> VideoInfo:
    with open_video(path) as frames:
        return frames.info


def trimmed(path: Path, source: Path) -> Path:
    """The same pictures in a container whose edit list leaves out the first four."""
    with av.open(str(source)) as whole, av.open(str(path), "w") as out:
        stream = whole.streams.video[0]
        copy = out.add_stream_from_template(stream)
        for packet in whole.demux(stream):
            if packet.dts is None:
                continue
            shift = round(4 / 25 / stream.time_base)
            packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, copy
            out.mux(packet)
    return path


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("h264.mp4", {}),
        ("h264.mov", {}),
        ("b_frames.mp4", {"options": {"bf": "3"} | STEADY, "times_ms": TIMES_MS}),
        ("later.mp4", {"options": STEADY, "times_ms": [1500 + t for t in TIMES_MS]}),
        ("ten_bit.mp4", {"pixel_format": "yuv420p10le"}),
        ("fragments.mp4", {"container_options": {"movflags": "frag_keyframe+empty_moov"}}),
        ("av1.mp4", {"codec": "libsvtav1"}),
        ("vp9.mp4", {"codec": "libvpx-vp9"}),
        ("hevc.mp4", {"codec": "libx265", "options": {"x265-params": "log-level=error"}}),
    ],
)
def test_what_the_viewer_plays_is_recorded_as_it_is(
    tmp_path: Path, name: str, options: dict[str, object]
) -> None:
    info = info_of(numbered_video(tmp_path / name, **options))
    mode, reason = choose_picture(info)
    assert mode == "video", reason
    assert ("ffmpeg" in reason) == (info.codec != "av1")


@pytest.mark.parametrize(
    ("name", "options", "because"),
    [
        ("a.mkv", {}, "opens MP4"),
        ("a.avi", {"codec": "mjpeg", "pixel_format": "yuvj420p"}, "opens MP4"),
        ("a.mp4", {"codec": "mpeg4"}, "codec mpeg4"),
        ("turned.mp4", {"turned": (90, False, False)}, "turn or mirror"),
        ("mirrored.mp4", {"turned": (0, True, False)}, "turn or mirror"),
        ("wide.mp4", {"sample_aspect": Fraction(16, 15)}, "pixel shape 16/15"),
        ("ticks.mp4", {"times_ms": TIMES_MS}, "says 1000 frames a second"),
    ],
)
def test_what_the_viewer_would_show_wrongly_is_recorded_as_frames(
    tmp_path: Path, name: str, options: dict[str, object], because: str
) -> None:
    info = info_of(numbered_video(tmp_path / name, **options))
    mode, reason = choose_picture(info)
    assert mode == "frames"
    assert because in reason
    with pytest.raises(UsageError, match=because):
        choose_picture(info, "video")


def test_interlaced_material_is_recorded_as_frames(tmp_path: Path) -> None:
    pictures = [woven(numbered(n), numbered(n + 1)) for n in range(0, 16, 2)]
    path = make_video(
        tmp_path / "fields.mp4",
        pictures,
        fields="tff",
        options={"x264-params": "tff=1"},
        flags=av.codec.context.Flags.interlaced_dct,
    )
    info = info_of(path)
    assert info.interlaced
    assert choose_picture(info).mode == "frames"
    assert choose_picture(replace(info, interlaced=False)).mode == "video"
    assert choose_picture(replace(info, interlaced=False), deinterlaced=True).mode == "frames"


def test_a_trimmed_file_is_recorded_as_frames(tmp_path: Path) -> None:
    """The viewer would show the pictures that the edit list leaves out, and all of them late."""
    source = numbered_video(tmp_path / "whole.mp4", options={"g": "30", "bf": "0"})
    info = info_of(trimmed(tmp_path / "trimmed.mp4", source))
    mode, reason = choose_picture(info)
    assert mode == "frames"
    assert "12 pictures where the file shows 8" in reason


def test_a_large_file_without_a_place_to_cut_is_recorded_as_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = info_of(numbered_video(tmp_path / "a.mp4", options={"g": "30"}))
    monkeypatch.setattr(pieces_module, "PIECE_BYTES", 10)
    monkeypatch.setattr(pieces_module, "LARGEST_PIECE_BYTES", info.size_bytes // 4)
    assert choose_picture(info).mode == "frames"


@pytest.mark.parametrize("options", [{"bf": "0"}, {"bf": "3"}, {"bf": "3", "x264-params": OPEN}])
def test_a_large_file_is_cut_where_frames_need_none_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, str]
) -> None:
    """Every piece can be decoded alone, and all of them together show every frame once."""
    path = numbered_video(tmp_path / "a.mp4", times_ms=TIMES_MS, options={"g": "4", **options})
    monkeypatch.setattr(pieces_module, "PIECE_BYTES", 10)
    cut = list(pieces(path, 0))
    assert len(cut) > 1 or "x264-params" in options
    shown = np.concatenate([piece.shown_s for piece in cut])
    np.testing.assert_allclose(shown - shown[0], np.array(TIMES_MS) / 1e3, atol=1e-6)
    for number, piece in enumerate(cut):
        alone = tmp_path / f"{number}.mp4"
        alone.write_bytes(bytes(piece.asset.blob.as_arrow_array()[0].values.to_numpy()))
        with av.open(str(alone)) as container:
            assert len(list(container.decode(video=0))) == len(piece.shown_s)


def test_references_find_the_piece_that_shows_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = numbered_video(tmp_path / "a.mp4", times_ms=TIMES_MS, options={"g": "4", "bf": "0"})
    monkeypatch.setattr(pieces_module, "PIECE_BYTES", 10)
    references = References()
    for piece in pieces(path, 0):
        references.add(piece)
    number, timestamps_ns = references.of(np.array(TIMES_MS) / 1e3)
    np.testing.assert_array_equal(number, np.repeat([0, 1, 2], 4))
    starts = np.repeat(np.array(TIMES_MS)[::4], 4)
    np.testing.assert_allclose(timestamps_ns / 1e6, np.array(TIMES_MS) - starts, atol=1e-3)


def test_without_ffmpeg_only_what_the_viewer_decodes_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture_module, "ffmpeg_plays", lambda: False)
    h264 = info_of(numbered_video(tmp_path / "h264.mp4"))
    av1 = info_of(numbered_video(tmp_path / "av1.mp4", codec="libsvtav1"))
    assert choose_picture(h264).mode == "frames"
    assert choose_picture(h264, "video").mode == "video"
    assert choose_picture(av1).mode == "video"


@pytest.mark.parametrize(
    ("says", "plays"),
    [
        ("ffmpeg version 4.4.2-0ubuntu0 Copyright", False),
        ("ffmpeg version 5.0.1 Copyright", False),
        ("ffmpeg version 5.1.9-0+deb12u1 Copyright", True),
        ("ffmpeg version n7.1 Copyright", True),
        ("ffmpeg version N-109542-g1bf1d3a Copyright", True),
    ],
)
def test_ffmpeg_must_be_new_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: str, plays: bool
) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!/bin/sh\necho '{says}'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    ffmpeg_plays.cache_clear()
    try:
        assert ffmpeg_plays() is plays
        monkeypatch.setenv("PATH", str(tmp_path / "nowhere"))
        ffmpeg_plays.cache_clear()
        assert not ffmpeg_plays()
    finally:
        ffmpeg_plays.cache_clear()


def test_as_asked_for(tmp_path: Path) -> None:
    info = info_of(numbered_video(tmp_path / "a.mp4"))
    for asked in ("video", "frames", "none"):
        assert choose_picture(info, asked).mode == asked  # type: ignore[arg-type]


def test_the_nearest_time_is_the_frames() -> None:
    times = np.array([0.07, 0.1, 0.13, 0.19])
    found = nearest(times, 0.07 + np.array([0.0, 0.0299, 0.061, 0.119, 9.0]))
    np.testing.assert_array_equal(found, [0, 1, 2, 3, 3])
    np.testing.assert_array_equal(nearest(times[:1], np.array([0.0])), [0])


@pytest.mark.parametrize("offset_ms", [0, 1500])
@pytest.mark.parametrize(("start_s", "every"), [(None, 1), (0.15, 3)])
def test_every_reference_is_to_the_frame_that_was_processed(
    tmp_path: Path, offset_ms: int, start_s: float | None, every: int
) -> None:
    path = numbered_video(
        tmp_path / "uneven.mp4",
        times_ms=[offset_ms + t for t in TIMES_MS],
        options={"bf": "3", "g": "6"} | STEADY,
    )
    out = tmp_path / "out.rrd"
    with open_video(path, start_s=start_s, every=every) as frames:
        info = frames.info
        with RecordingWriter(out, recording_id="id", picture="video", video=info) as writer:
            processed, seen = [], []
            for frame in frames:
                writer.picture_frame(frame)
                processed.append(frame.index)
                seen.append(frame)
            writer.write([], make_provenance(), timeline_of(seen))
    recording = Recording(out)
    rows = recording.rows("/video", "VideoFrameReference:timestamp")
    assert [frame for frame, _, _ in rows] == processed
    # In the file, and so for the viewer, the pictures keep their distances.
    shown = np.array([value[0] for _, _, value in rows]) / 1e6
    np.testing.assert_allclose(
        shown - shown[0], np.array(TIMES_MS)[processed] - TIMES_MS[processed[0]]
    )
    np.testing.assert_allclose(
        [time_s for _, time_s, _ in rows], np.array(TIMES_MS)[processed] / 1e3, atol=2e-9
    )
    assert bytes(recording.static("/video_file/0000", "AssetVideo:blob")[0]) == path.read_bytes()


@pytest.mark.shared
def test_real_videos_keep_their_times(shared: Path) -> None:
    for path in sorted((shared / "videos").glob("*.mp4")):
        [piece] = pieces(path, 0)
        references = References()
        references.add(piece)
        timestamps = piece.timestamps_ns
        with open_video(path) as frames:
            time_s = np.array([frame.time_s for frame in frames])
            assert choose_picture(frames.info).mode == "video"
        assert len(timestamps) == len(time_s)
        np.testing.assert_allclose((timestamps - timestamps[0]) / 1e9, time_s, atol=1e-6)
        np.testing.assert_array_equal(references.of(time_s)[1], timestamps)
