"""The picture in a recording: the video file itself, its frames as JPEG, or none.

The Rerun viewer plays MP4 itself and shows every file at its coded size: it knows no rotation
metadata, no pixel shape and no edit list. Where any of these matters, or the codec is one it
cannot play, the frames are recorded as they were processed, at many times the size.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from dance2pose.errors import OutputError, UsageError, VideoError
from dance2pose.poses import Image
from dance2pose.recording.pieces import pieces

if TYPE_CHECKING:
    from dance2pose.video import VideoInfo

PictureMode = Literal["video", "frames", "none"]

# What the viewer plays, by the codec names of FFmpeg.
_PLAYABLE_CODECS = ("h264", "hevc", "av1", "vp9")
_DECODED_BY_THE_VIEWER = ("av1",)
_CONTAINERS = ("mp4", "mov")
_OLDEST_FFMPEG = (5, 1)
# H.264 and H.265 go to ffmpeg without their container, and it takes no such rate from the stream
# (measured with rerun 0.41: 990 plays, 1000 does not). Encoders that count in milliseconds or at
# 90 kHz write such rates into files of any real rate.
_UNPLAYABLE_RATE = 1000
JPEG_QUALITY = 85


class PictureChoice(NamedTuple):
    """How the picture is recorded, and why, in words for the person who asked."""

    mode: PictureMode
    reason: str


def choose_picture(
    info: VideoInfo,
    requested: Literal["auto", "video", "frames", "none"] = "auto",
    deinterlaced: bool = False,
) -> PictureChoice:
    """Decide how the picture of a video is recorded.

    Raises UsageError where `video` is requested and the viewer could not show it rightly.
    """
    if requested == "none":
        return PictureChoice("none", "as asked for; the keypoints are shown on their own")
    if requested == "frames":
        return PictureChoice("frames", "as asked for; JPEG shows in every viewer")
    obstacle = _obstacle(info, deinterlaced)
    if requested == "video":
        if obstacle:
            raise UsageError(f"{info.path}: cannot be recorded with --picture video: {obstacle}")
        return PictureChoice("video", f"the original file, as asked for; {_viewing_needs(info)}")
    if obstacle:
        return PictureChoice("frames", f"as JPEG: {obstacle}")
    if info.codec not in _DECODED_BY_THE_VIEWER and not ffmpeg_plays():
        return PictureChoice(
            "frames",
            f"as JPEG: no ffmpeg 5.1 or later is on PATH here, and the viewer needs it for "
            f"{info.codec}; --picture video records the original file all the same",
        )
    return PictureChoice("video", f"the original file; {_viewing_needs(info)}")


def _viewing_needs(info: VideoInfo) -> str:
    if info.codec in _DECODED_BY_THE_VIEWER:
        return f"the viewer plays {info.codec} without help"
    return (
        f"the machine it is viewed on needs ffmpeg 5.1 or later on PATH for {info.codec} "
        "(--picture frames needs nothing)"
    )


def _obstacle(info: VideoInfo, deinterlaced: bool) -> str | None:
    """Why the viewer cannot show the file itself, or None."""
    container = set(re.split(r"[,\s]+", info.container.lower()))
    if not container.intersection(_CONTAINERS):
        return f"the viewer opens MP4, this file is {info.container}"
    if info.codec not in _PLAYABLE_CODECS:
        return f"the viewer does not play the codec {info.codec}"
    if info.other_tracks:
        return f"the viewer may show another track of the file than track {info.track}"
    if info.rotation_degrees % 360 or info.mirrored:
        return "the viewer would not turn or mirror the picture as the file says"
    if info.sample_aspect_ratio != 1:
        return f"the viewer would not undo the pixel shape {info.sample_aspect_ratio}"
    if deinterlaced or info.interlaced:
        return "the file is interlaced, and the viewer would show both fields at once"
    try:
        for _ in pieces(info.path, info.track):
            pass  # each is looked at as the viewer will
        stream_rate = _stream_rate(info.path, info.track)
    except VideoError as error:
        return str(error)
    if stream_rate >= _UNPLAYABLE_RATE:
        return (
            f"its {info.codec} stream says {stream_rate:.0f} frames a second (whatever its "
            "timestamps say), for which the viewer shows nothing"
        )
    return None


@lru_cache(maxsize=1)
def ffmpeg_plays() -> bool:
    """Whether an ffmpeg that the viewer can use is on PATH."""
    program = shutil.which("ffmpeg")
    if program is None:
        return False
    try:
        answer = subprocess.run(
            [program, "-version"], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return False
    version = re.match(r"ffmpeg version n?(\d+)\.(\d+)", answer.stdout)
    # Builds from a snapshot carry no number; they are newer than any that is too old.
    return version is None or tuple(map(int, version.groups())) >= _OLDEST_FFMPEG


def _stream_rate(path: Path, track: int) -> float:
    """The frames a second that the coded stream itself speaks of, 0 where it does not."""
    import av

    try:
        with av.open(str(path)) as container:
            stream = next(s for s in container.streams.video if s.index == track)
            return float(stream.codec_context.framerate or 0)
    except (av.FFmpegError, StopIteration) as error:
        raise VideoError(f"{path}: cannot be opened again: {error}") from error


def encode_jpeg(image: Image) -> bytes:
    """A BGR picture as the bytes of a JPEG file."""
    import cv2

    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    if not done:
        raise OutputError(f"a picture of shape {image.shape} could not be encoded as JPEG")
    return data.tobytes()
