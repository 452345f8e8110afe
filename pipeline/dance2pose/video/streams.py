"""Which track of a file is its film.

Files hold posters, thumbnails, second angles and slides beside the film, marked as such or not.
The film is the track that moves most: what counts is how many pictures it has, and over how long.
Flags and sizes decide between equals only.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av.error
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream

from dance2pose.errors import VideoError
from dance2pose.video.unreadable import why_undecodable

# More pictures a second than this do not make a track more of a film.
ENOUGH_A_SECOND = 25

# A track with this part of the most pictures is as good as the one that has them.
AS_GOOD = 0.8

# Packets looked at where a file has several tracks, enough for two hours of two films.
MOST_PACKETS = 500_000

_NO_FILM = Disposition.attached_pic | Disposition.timed_thumbnails


@dataclass
class Track:
    """What the packets of a video track say. first_s, last_s: of its pictures, None without."""

    stream: VideoStream
    pictures: int = 0
    first_s: float | None = None
    last_s: float | None = None

    @property
    def length_s(self) -> float:
        """From the first picture to the last."""
        if self.first_s is None or self.last_s is None:
            return 0.0
        return self.last_s - self.first_s

    @property
    def moving(self) -> float:
        """How much of a film it is: pictures, as far as they come one after the other."""
        return min(self.pictures, 1 + ENOUGH_A_SECOND * self.length_s)

    def count(self, time_s: float | None) -> None:
        """One more picture, at `time_s`."""
        self.pictures += 1
        if time_s is not None:
            self.first_s = time_s if self.first_s is None else min(self.first_s, time_s)
            self.last_s = time_s if self.last_s is None else max(self.last_s, time_s)

    def __str__(self) -> str:
        context = self.stream.codec_context
        if context is None:
            return f"track {self.stream.index} (of a codec FFmpeg cannot decode here)"
        pictures = "1 picture" if self.pictures == 1 else f"{self.pictures} pictures"
        return (
            f"track {self.stream.index} ({context.codec.canonical_name}, "
            f"{context.width} x {context.height} px, {pictures})"
        )


def choose_stream(
    path: Path, container: InputContainer, again: InputContainer | None = None
) -> tuple[VideoStream, tuple[str, ...]]:
    """The video stream to read, and in words the tracks left out.

    again: the same file opened a second time, to count the pictures of several tracks; without it
    the first of them is taken. Raises VideoError where there is none.
    """
    streams = list(container.streams.video)
    films = [stream for stream in streams if not stream.disposition & _NO_FILM]
    if not films:
        kinds = {stream.type for stream in container.streams if stream.type != "video"}
        found = ", ".join([*sorted(kinds), *(["a cover picture"] if streams else [])])
        raise VideoError(f"{path}: holds no video, only: {found or 'no stream'}")
    decodable = [stream for stream in films if stream.codec_context is not None]
    if not decodable:
        why = why_undecodable(path) or "its video codec cannot be decoded here; convert it"
        raise VideoError(f"{path}: {why}")
    if len(films) == 1 or again is None:
        return decodable[0], ()
    tracks = {stream.index: Track(stream) for stream in films}
    _count(again, tracks)
    best = _film([tracks[stream.index] for stream in decodable])
    return best.stream, tuple(str(track) for track in tracks.values() if track is not best)


def _count(container: InputContainer, tracks: dict[int, Track]) -> None:
    """Count the pictures of every track and when they are shown, without decoding any."""
    wanted = [container.streams[index] for index in tracks]
    seen = 0
    try:
        for packet in container.demux(wanted):
            if not packet.size or packet.is_discard:
                continue
            time, base = packet.pts if packet.pts is not None else packet.dts, packet.time_base
            time_s = None if time is None or base is None else float(time * base)
            tracks[packet.stream_index].count(time_s)
            seen += 1
            if seen >= MOST_PACKETS:
                return
    except av.error.FFmpegError:
        return  # damaged from here on: what was counted must do


def _film(tracks: list[Track]) -> Track:
    """The track that moves most; between equals the one marked as default, then the larger."""
    most = max(track.moving for track in tracks)

    def rank(track: Track) -> tuple[bool, int, int]:
        stream = track.stream
        size = stream.codec_context.width * stream.codec_context.height
        return bool(stream.disposition & Disposition.default), size, -stream.index

    return max((track for track in tracks if track.moving >= AS_GOOD * most), key=rank)
