"""A video file as pieces that the viewer plays one after the other.

A file goes into a recording as an `AssetVideo`, which is held in memory several times over while
it is written. So a long one is cut at key frames into small MP4 files, its packets copied as they
are, and every frame refers to its piece. Memory then holds one piece, whatever the length. (Rerun's
`VideoStream` takes samples one by one, but none with B-frames and no VP9.)
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dance2pose.errors import VideoError
from dance2pose.poses import IntArray

if TYPE_CHECKING:
    from av.packet import Packet
    from av.video.stream import VideoStream

    VideoPacket = Packet[VideoStream]

    from dance2pose.recording.quiet_rerun import rr

Timestamps = npt.NDArray[np.int64]

# A piece ends at the next key frame after this many bytes ...
PIECE_BYTES = 4 * 1024**2
# ... and a file whose key frames are further apart than this is not cut. Writing a piece takes
# about 4.2 times its size of memory (measured, rerun 0.41).
LARGEST_PIECE_BYTES = 512 * 1024**2
# The viewer's times and the file's own agree to within rounding.
_ROUNDING_S = 1e-3


@dataclass(frozen=True)
class Piece:
    """A part of a video as the viewer plays it.

    timestamps_ns: (T,) by which the viewer knows its frames, increasing. shown_s: (T,) when the
    whole video shows the same frames, in the time of its container.
    """

    asset: rr.AssetVideo
    timestamps_ns: Timestamps
    shown_s: npt.NDArray[np.float64]


def pieces(path: Path, track: int) -> Iterator[Piece]:
    """Cut a video into pieces, in order; a small one is one piece, the file as it is.

    track: the index of the video's stream in the file.

    Raises VideoError where the viewer could not play it.
    """
    import av

    try:
        with av.open(str(path)) as container:
            stream = next(s for s in container.streams.video if s.index == track)
            if path.stat().st_size <= PIECE_BYTES:
                shown = [packet for packet in container.demux(stream) if not packet.is_discard]
                yield _read(path.read_bytes(), _shown_s(shown))
                return
            gathered: list[VideoPacket] = []
            size = 0
            for group in _closed_groups(container.demux(stream)):
                if size >= PIECE_BYTES:
                    yield _piece(gathered, stream)
                    gathered, size = [], 0
                gathered += group
                size += sum(packet.size for packet in group)
                if size > LARGEST_PIECE_BYTES:
                    raise VideoError(
                        f"it has no key frame to cut at for more than "
                        f"{LARGEST_PIECE_BYTES / 1e6:.0f} MB"
                    )
            if gathered:
                yield _piece(gathered, stream)
    except (av.FFmpegError, StopIteration) as error:
        raise VideoError(f"{path}: its packets cannot be read: {error}") from error
    except OSError as error:
        raise VideoError(f"{path}: cannot be read: {error.strerror}") from error


def _closed_groups(packets: Iterable[VideoPacket]) -> Iterator[list[VideoPacket]]:
    """Packets from one key frame to before the next that can be decoded from it alone.

    Frames that are shown before the key frame they follow in the file need the group before too;
    such a key frame begins no group.
    """
    group: list[VideoPacket] = []
    latest: list[VideoPacket] = []  # from the last key frame on
    for packet in packets:
        if packet.size == 0 or packet.pts is None:
            continue
        if packet.is_discard:
            raise VideoError("it has an edit list, which the viewer does not know")
        if packet.is_keyframe and latest:
            yield from _ended(group, latest)
            latest = []
        latest.append(packet)
    yield from _ended(group, latest)
    if group:
        yield group


def _ended(group: list[VideoPacket], latest: list[VideoPacket]) -> Iterator[list[VideoPacket]]:
    """Take the packets since a key frame into the group, or give it out and begin with them."""
    times = [packet.pts or 0 for packet in latest]
    if group and times and min(times) == times[0]:
        yield group.copy()
        group.clear()
    group += latest


def _piece(packets: list[VideoPacket], stream: VideoStream) -> Piece:
    """An MP4 file of these packets, in memory."""
    import av

    shown_s = _shown_s(packets)
    first = min((packet.dts for packet in packets if packet.dts is not None), default=0)
    file = io.BytesIO()
    with av.open(file, "w", format="mp4") as output:
        copy = output.add_stream_from_template(stream)
        for packet in packets:
            assert packet.pts is not None  # held by _closed_groups
            packet.pts -= first
            if packet.dts is not None:
                packet.dts -= first
            packet.stream = copy
            output.mux(packet)
    return _read(file.getvalue(), shown_s)


def _shown_s(packets: Iterable[VideoPacket]) -> npt.NDArray[np.float64]:
    """When a player shows the pictures of packets, sorted."""
    times = [float(p.pts * p.time_base) for p in packets if p.pts is not None]
    return np.sort(np.array(times, np.float64))


def _read(contents: bytes, shown_s: npt.NDArray[np.float64]) -> Piece:
    """A file of pictures that are shown at these times, read as the viewer reads it."""
    from dance2pose.recording.quiet_rerun import rr

    try:
        # The bytes are given, not the path: Rerun takes .mov and other names for unknown.
        asset = rr.AssetVideo(contents=contents, media_type="video/mp4")
        timestamps_ns = np.sort(asset.read_frame_timestamps_nanos())
    except (RuntimeError, ValueError) as error:
        raise VideoError(f"the viewer cannot open it: {error}") from error
    if not len(timestamps_ns):
        raise VideoError("the viewer finds no frame in it")
    if not _agree(timestamps_ns, shown_s):
        raise VideoError(
            f"the viewer sees {len(timestamps_ns)} pictures where the file shows {len(shown_s)}, "
            "or at other times (an edit list, or damage)"
        )
    return Piece(asset, timestamps_ns, shown_s)


def _agree(timestamps_ns: Timestamps, shown_s: npt.NDArray[np.float64]) -> bool:
    """Whether both lists have the same frames, but for one offset common to all."""
    if len(timestamps_ns) != len(shown_s):
        return False
    theirs = (timestamps_ns - timestamps_ns[0]) / 1e9
    return bool(np.abs(theirs - (shown_s - shown_s[0])).max() < _ROUNDING_S)


class References:
    """Which frame of which piece is to be seen at a time. Add the pieces in order."""

    def __init__(self) -> None:
        self._shown_s: list[npt.NDArray[np.float64]] = []
        self._timestamps_ns: list[Timestamps] = []

    def __len__(self) -> int:
        return len(self._shown_s)

    def add(self, piece: Piece) -> None:
        self._shown_s.append(piece.shown_s)
        self._timestamps_ns.append(piece.timestamps_ns)

    def of(self, time_s: npt.NDArray[np.float64]) -> tuple[IntArray, Timestamps]:
        """The piece (N,) and its timestamp (N,) of frames at `time_s` (N,).

        Frame time counts from the first frame of the video; what containers count from differs.
        """
        shown_s = np.concatenate(self._shown_s)
        order = np.argsort(shown_s, kind="stable")
        row = order[nearest(shown_s[order], np.asarray(time_s) + shown_s.min())]
        lengths = [len(times) for times in self._shown_s]
        piece: IntArray = np.repeat(np.arange(len(lengths)), lengths)[row]
        timestamps_ns: Timestamps = np.concatenate(self._timestamps_ns)[row]
        return piece, timestamps_ns


def nearest(times: npt.NDArray[np.float64], wanted: npt.NDArray[np.float64]) -> IntArray:
    """Indices (N,) of those of increasing `times` that are nearest to `wanted` (N,)."""
    after = np.searchsorted(times, wanted).clip(0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearer = wanted - times[before] <= times[after] - wanted
    found: IntArray = np.where(nearer, before, after).astype(np.int64)
    return found
