"""What a video file is, as its container, its codec and its first pictures say."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.video.frame import VideoFrame

from dance2pose.video.deinterlace import Interlacing
from dance2pose.video.picture import (
    HDR_TRANSFERS,
    MATRIX_NAMES,
    Orientation,
    colour_matrix,
    full_range,
    sensible_aspect,
    square_size,
)
from dance2pose.video.source import Source


@dataclass(frozen=True)
class VideoInfo:
    """A video file described.

    width, height: of the frames as read: upright, in square pixels. stored_width, stored_height: of
    the picture in the file. rotation_degrees: clockwise turn, and mirrored: left-right flip before
    it, that made the picture upright. sample_aspect_ratio: width over height of a stored sample, 1
    where the file says nothing. interlaced: whether fields were found; field_order and
    interlaced_because say which and how it is known. duration_s, frame_count: as the container
    says, None where it does not. frame_rate: average frames a second, for information only (time
    is each frame's own timestamp). start_time_s: the stream's first timestamp, which is time 0 of
    the frames. colour_matrix: as used, stated in the file or not. full_range: luma 0..255.
    hdr: "PQ", "HLG" or None.
    """

    path: Path
    size_bytes: int
    width: int
    height: int
    container: str
    codec: str
    pixel_format: str
    rotation_degrees: int
    sample_aspect_ratio: Fraction
    interlaced: bool
    duration_s: float | None
    frame_count: int | None
    frame_rate: float | None
    stored_width: int
    stored_height: int
    mirrored: bool
    field_order: str
    interlaced_because: str
    start_time_s: float | None
    colour_matrix: str
    full_range: bool
    hdr: str | None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px of the frames as read."""
        return self.width, self.height


def describe(
    source: Source,
    picture: VideoFrame,
    turned: Orientation,
    interlacing: Interlacing,
) -> VideoInfo:
    """The description of an opened file and its first picture."""
    stream, container = source.stream, source.container
    aspect = sensible_aspect(stream.sample_aspect_ratio)
    width, height = turned.size(*square_size(picture.width, picture.height, aspect))
    duration_s: float | None = None
    if stream.duration is not None and stream.time_base is not None:
        duration_s = float(stream.duration * stream.time_base)
    elif container.duration is not None:
        duration_s = container.duration / av.time_base
    rate = stream.guessed_rate or stream.average_rate
    if stream.frames and duration_s:
        rate = Fraction(stream.frames / duration_s)
    start_s = None
    if stream.start_time is not None and stream.time_base is not None:
        start_s = float(stream.start_time * stream.time_base)
    return VideoInfo(
        path=source.path,
        size_bytes=source.path.stat().st_size,
        width=width,
        height=height,
        container=container.format.name,
        codec=stream.codec_context.codec.canonical_name,
        pixel_format=picture.format.name,
        rotation_degrees=turned.degrees,
        sample_aspect_ratio=aspect,
        interlaced=interlacing.found,
        duration_s=duration_s if duration_s and duration_s > 0 else None,
        frame_count=stream.frames or None,
        frame_rate=float(rate) if rate else None,
        stored_width=picture.width,
        stored_height=picture.height,
        mirrored=turned.mirrored,
        field_order=interlacing.field_order,
        interlaced_because=interlacing.because,
        start_time_s=start_s,
        colour_matrix="RGB" if picture.format.is_rgb else MATRIX_NAMES[colour_matrix(picture)],
        full_range=full_range(picture),
        hdr=HDR_TRANSFERS.get(int(picture.color_trc)),
    )
