"""What a video file is, as its container, its codec and its first pictures say."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.video.frame import VideoFrame

from dance2pose.video.canvas import canvas_size
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

    width, height: of the frames as read: upright, in square pixels, wide enough for the widest
    picture. stored_width, stored_height: of the picture in the file. rotation_degrees: clockwise
    turn, and mirrored: left-right flip before it, that made the picture upright.
    sample_aspect_ratio: width over height of a stored sample of the first picture, 1 where the file
    says nothing. interlaced: whether fields were found; field_order and interlaced_because say
    which and how it is known. duration_s, frame_count: as the file announces, None where it does
    not. frame_rate: average frames a second, for information only (time is each frame's own
    timestamp). start_time_s: the stream's first timestamp, which is time 0 of the frames.
    file_offset_s: how much later than the file's first sound or picture that is. colour_matrix: as
    used, stated in the file or not. full_range: luma 0..255. hdr: "PQ", "HLG" or None. track:
    number of the video's track in the file. other_tracks: video tracks left out.
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
    file_offset_s: float
    colour_matrix: str
    full_range: bool
    hdr: str | None
    track: int = 0
    other_tracks: tuple[str, ...] = ()

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
    announced = source.announced
    aspect = sensible_aspect(stream.sample_aspect_ratio)
    first = square_size(picture.width, picture.height, aspect)
    width, height = turned.size(*canvas_size(source, first))
    rate = stream.guessed_rate or stream.average_rate
    if stream.frames and announced.shown and announced.length_s:
        rate = Fraction(announced.shown / announced.length_s)
    start_s = offset_s = None
    if stream.start_time is not None and stream.time_base is not None:
        start_s = float(stream.start_time * stream.time_base)
        offset_s = start_s - (container.start_time or 0) / av.time_base
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
        duration_s=announced.length_s,
        frame_count=announced.shown,
        frame_rate=float(rate) if rate else None,
        stored_width=picture.width,
        stored_height=picture.height,
        mirrored=turned.mirrored,
        field_order=interlacing.field_order,
        interlaced_because=interlacing.because,
        start_time_s=start_s,
        file_offset_s=max(0.0, offset_s or 0.0),
        colour_matrix="RGB" if picture.format.is_rgb else MATRIX_NAMES[colour_matrix(picture)],
        full_range=full_range(picture),
        hdr=HDR_TRANSFERS.get(int(picture.color_trc)),
        track=stream.index,
        other_tracks=source.other_tracks,
    )
