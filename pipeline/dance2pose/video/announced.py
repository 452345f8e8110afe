"""How many pictures a file announces, and how long it says that it lasts.

A file tells these in several places and on several clocks: a header's count includes pictures that
an edit list hides; AVI counts pictures that were dropped and have no data; Matroska's tags give the
end of a track by one program and its length by another.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av
import av.error
from av.container import InputContainer
from av.video.stream import VideoStream

# Containers whose index lists every picture, not only those to seek to.
_INDEX_LISTS_ALL = frozenset({"mov", "avi"})


@dataclass(frozen=True)
class Announced:
    """What a file announces of its video track.

    packets: that hold a picture, hidden ones included, 0 where it does not say. shown: of those,
    the ones to be shown, None where it does not say. length_s: from the first picture's start to
    the last one's end.
    """

    packets: int
    shown: int | None
    length_s: float | None


def read_announced(path: Path, container: InputContainer, stream: VideoStream) -> Announced:
    """Ask the index, the header and the tags of a file just opened."""
    length_s = _length_s(container, stream)
    entries = stream.index_entries if _formats(container) & _INDEX_LISTS_ALL else ()
    held = shown = 0
    for entry in entries:  # none is kept: an hour has a hundred thousand
        held += entry.size > 0
        shown += entry.size > 0 and not entry.is_discard
    if not held:
        return Announced(stream.frames, stream.frames or None, length_s)
    # An index cut short is a loss; one that edits cut short, or dropped pictures, is none.
    lost = 0
    if len(entries) < stream.frames:
        lost = stream.frames - _listed(path, container, stream)
    return Announced(held + lost, shown + lost if stream.frames else None, length_s)


def _formats(container: InputContainer) -> set[str]:
    return set(container.format.name.split(","))


def _listed(path: Path, container: InputContainer, stream: VideoStream) -> int:
    """How many of the pictures in the header's count the index accounts for."""
    if "avi" in _formats(container):  # its entries are numbered, those without data left out
        return min(stream.frames, max(entry.timestamp for entry in stream.index_entries) + 1)
    return min(stream.frames, _without_edits(path, stream.index))


def _without_edits(path: Path, track: int) -> int:
    """How many pictures the index of an MP4 or MOV lists if its edit list is not looked at."""
    options = {"ignore_editlist": "1", "protocol_whitelist": "file"}
    try:
        with path.open("rb") as file, av.open(file, options=options) as container:
            stream = container.streams[track]
            return len(stream.index_entries) if isinstance(stream, VideoStream) else 0
    except (av.error.FFmpegError, IndexError):
        return 0


def _length_s(container: InputContainer, stream: VideoStream) -> float | None:
    if stream.duration is not None and stream.time_base is not None:
        length_s = float(stream.duration * stream.time_base)
    else:
        tagged_s = tagged_length_s(stream)
        if tagged_s is not None:
            return tagged_s
        if container.duration is None:
            return None
        length_s = container.duration / av.time_base - _start_s(stream)
    return length_s if length_s > 0 else None


def tagged_length_s(stream: VideoStream) -> float | None:
    """How long a Matroska track lasts as its own tag says; survives the loss of its end.

    mkvmerge, which writes the app's name beside it, tags the length; FFmpeg tags the time of the
    end on the file's clock.
    """
    text = stream.metadata.get("DURATION", "")
    try:
        hours, minutes, seconds = (float(part) for part in text.strip("\0").split(":"))
    except ValueError:
        return None
    tagged_s = 3600 * hours + 60 * minutes + seconds
    is_length = "_STATISTICS_WRITING_APP" in stream.metadata
    length_s = tagged_s if is_length else tagged_s - _start_s(stream)
    return length_s if length_s > 0 else None


def _start_s(stream: VideoStream) -> float:
    """The track's first timestamp on the file's clock, 0 where it has none."""
    if stream.start_time is None or stream.time_base is None:
        return 0.0
    return float(stream.start_time * stream.time_base)
