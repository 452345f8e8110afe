"""Start in the middle of a long video without decoding all before it, and still know each frame's
number.

The packets up to the start are read but not decoded, which costs little more than reading the
file. Sorting their presentation timestamps numbers the pictures. Where that cannot be relied on
(packets without timestamps, repeated ones, containers that do not store one picture a packet), the
video is decoded from its beginning instead: the number must be right, whatever it costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import av.error

from dance2pose.errors import VideoError
from dance2pose.video.source import Source

# Below this many seconds to skip, decoding through is as quick.
LEAST_SKIP_S = 5.0

# Pictures may be stored this much earlier or later than they are shown.
REORDER_S = 2.0


@dataclass(frozen=True)
class Entry:
    """A key picture to decode from. pts: its timestamp. index: its number in presentation order.
    packets_before: packets shown before it, those an edit list hides included."""

    pts: int
    index: int
    packets_before: int


def find_entry(path: Path, track: int, target_pts: int) -> Entry | None:
    """The last key picture of a track before `target_pts` (in its time base) with its number, or
    None where the packets do not tell it."""
    try:
        source = Source(path, track=track)
    except VideoError:
        return None
    try:
        return _scan(source, target_pts)
    except av.error.FFmpegError:
        return None
    finally:
        source.close()


def _scan(source: Source, target_pts: int) -> Entry | None:
    time_base = source.stream.time_base
    if not source.one_packet_a_picture or time_base is None:
        return None
    reorder = int(REORDER_S / time_base)
    shown: list[int] = []
    hidden: list[int] = []
    keys: list[int] = []
    latest: int | None = None
    for packet in source.container.demux(source.stream):
        if not packet.size:
            break
        if packet.pts is None or packet.is_corrupt:
            return None
        if latest is not None and packet.pts < latest - reorder:
            return None  # the timestamps begin again
        latest = packet.pts if latest is None else max(latest, packet.pts)
        (hidden if packet.is_discard else shown).append(packet.pts)
        if packet.is_keyframe and not packet.is_discard:
            keys.append(packet.pts)
        if packet.pts > target_pts + reorder:
            break
    before = [pts for pts in keys if pts < target_pts]
    if not before or len(set(shown)) != len(shown):
        return None
    key = max(before)
    index = sum(pts < key for pts in shown)
    return Entry(key, index, index + sum(pts < key for pts in hidden))
