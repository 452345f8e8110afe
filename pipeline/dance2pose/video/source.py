"""A video file -> the pictures its decoder gives, and a count of what was lost on the way."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import av.error
from av.container import InputContainer
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from dance2pose.errors import VideoError
from dance2pose.video.announced import read_announced
from dance2pose.video.ffv1 import Checksums
from dance2pose.video.streams import choose_stream

# 8192 x 8192. Larger than any video camera's picture; a header that says more is damaged or hostile
# and must not make us allocate gigabytes.
MAX_PIXELS = 8192 * 8192

# A read error may be a scratch in the middle of a file: go on, but not for ever.
MAX_READ_ERRORS_IN_A_ROW = 50

# FFmpeg "formats" that are no video: pictures of text, and lists that name other files.
NOT_VIDEO = frozenset({"tty", "hls", "concat", "dash", "imf", "sdp", "rtsp", "webm_dash_manifest"})

# Containers that store one packet a picture, so that counting packets counts pictures. (Transport
# streams may store one packet a field; VP8 in WebM has packets that are never shown.)
ONE_PACKET_A_PICTURE = frozenset({"mov", "matroska", "avi", "mxf"})
HIDDEN_PICTURES = frozenset({"vp8", "mpeg4", "msmpeg4v3"})

# Packets at the beginning whose pictures may come before the first that can be decoded.
EARLY_PACKETS = 256

# What costs much to decode at any size, and pictures that do in any codec.
HEAVY_CODECS = frozenset({"ffv1", "prores", "jpeg2000", "vvc"})
LARGE_PIXELS = 1_000_000

# Decoding threads at most; each holds a picture.
MAX_THREADS = 4


def check_file(path: Path) -> int:
    """The size in bytes of a readable, non-empty regular file. VideoError for anything else."""
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise VideoError(f"{path}: is a folder, not a video; name one video file")
        if not stat.S_ISREG(status.st_mode):
            raise VideoError(f"{path}: is a device or a pipe, not a video file; copy it to a file")
        if status.st_size == 0:
            raise VideoError(f"{path}: is empty (0 bytes); copy or record it again")
        with path.open("rb"):
            return status.st_size
    except FileNotFoundError:
        raise VideoError(f"{path}: no such file; check the name and the folder") from None
    except PermissionError:
        raise VideoError(f"{path}: may not be read; give yourself the right to read it") from None
    except OSError as error:
        raise VideoError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a NUL byte in the name
        raise VideoError(f"{str(path)!r}: is no file name: {error}") from None


def open_container(path: Path) -> InputContainer:
    """Open with FFmpeg, for this file alone: no other file and no network."""
    check_file(path)
    # "file:" keeps a name such as "concat:a" or "c:a" from being read as a protocol. An absolute
    # path is as long as it is; a relative one may be short where the absolute one is too long.
    name = f"file:{path}"
    options = {"max_pixels": str(MAX_PIXELS), "protocol_whitelist": "file"}
    source: Any = name
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:  # a name in some older encoding: let Python open it
        source = path.open("rb")
    try:
        container: InputContainer = av.open(source, "r", options=options, metadata_errors="replace")
    except av.error.FFmpegError as error:
        raise VideoError(_why_not(path, error)) from None
    if NOT_VIDEO & set(container.format.name.split(",")):
        container.close()
        raise VideoError(
            f"{path}: is a text or list file, which FFmpeg calls {container.format.name!r},"
            " not a video"
        )
    return container


def _why_not(path: Path, error: Exception) -> str:
    with path.open("rb") as file:
        head = file.read(12)
    if head[4:8] == b"ftyp":
        return (
            f"{path}: is an MP4 or MOV file whose index (moov) is missing or damaged, as when a"
            " recording or a copy was cut short; copy it again, or rebuild the index from another"
            " recording of the same camera"
        )
    reason = getattr(error, "strerror", None) or str(error)
    return f"{path}: is not a video that FFmpeg can read ({reason}); expected MP4, MKV, AVI, MOV …"


def check_size(path: Path, width: int, height: int) -> None:
    """Refuse a picture nobody films before memory is taken for it."""
    if width * height > MAX_PIXELS:
        raise VideoError(
            f"{path}: says its picture is {width} x {height} px, more than {MAX_PIXELS} in all;"
            " the header is damaged, or the video must be made smaller first"
        )


def _set_threads(context: VideoCodecContext) -> None:
    """Spread the decoding of large pictures over half of the cores, whole frames at a time.

    The rest is the models'. Small pictures are decoded in one thread: more cost a third more
    processor time (0.79 ms a picture against 0.56 at 384 x 496). So are all on two cores: beside
    two models that use both, 1088 x 1920 px come at 73 ms a frame with one decoding thread and at
    75 with two, of which the models take 64.

    Never slices, PyAV's default: with them FFmpeg's H.264 decoder neither repairs nor reports
    damage.
    """
    heavy = context.codec.canonical_name in HEAVY_CODECS
    large = context.width * context.height > LARGE_PIXELS
    spare = (os.cpu_count() or 1) // 2
    context.thread_type = "FRAME"
    context.thread_count = max(1, min(MAX_THREADS, spare)) if heavy or large else 1


class Source:
    """The decoder of one file.

    track: number of the track to read, the film among them if not given. other_tracks: in words,
    those left out. packets, frames: how many were read and decoded, `discarded` of the packets
    being hidden by an edit list. decode_errors: packets the decoder refused. read_errors: places
    that could not be read. damaged_packets, damaged_frames: flagged so by the demuxer, the
    decoder. complete: True once the end of the file was reached.
    """

    def __init__(self, path: Path, *, track: int | None = None) -> None:
        self.path = path
        self.container = open_container(path)
        self.other_tracks: tuple[str, ...] = ()
        try:
            self.stream = self._choose(track)
            self.announced = read_announced(path, self.container, self.stream)
        except BaseException:
            self.container.close()
            raise
        context = self.stream.codec_context
        context.options = {"max_pixels": str(MAX_PIXELS)}
        _set_threads(context)
        self.packets = 0
        self.discarded = 0
        self.frames = 0
        self.decode_errors = 0
        self.read_errors = 0
        self.damaged_packets = 0
        self.damaged_frames = 0
        self.complete = False
        self._checksums = Checksums() if context.codec.canonical_name == "ffv1" else None
        self._first_pts: int | None = None
        self._packets_before = 0
        self._first_shown_pts: int | None = None
        self._early_pts: list[int] = []

    def _choose(self, track: int | None) -> VideoStream:
        if track is not None:
            return next(s for s in self.container.streams.video if s.index == track)
        again = open_container(self.path) if len(self.container.streams.video) > 1 else None
        try:
            stream, self.other_tracks = choose_stream(self.path, self.container, again)
        finally:
            if again is not None:
                again.close()
        context = stream.codec_context
        check_size(self.path, context.width, context.height)
        return stream

    @property
    def one_packet_a_picture(self) -> bool:
        """Whether each packet of this file holds one picture, and each is shown."""
        names = set(self.container.format.name.split(","))
        hides = self.stream.codec_context.name in HIDDEN_PICTURES
        return bool(names & ONE_PACKET_A_PICTURE) and not hides

    def close(self) -> None:
        self.container.close()

    def seek(self, pts: int, packets_before: int) -> None:
        """Go on from the key picture at `pts`; nothing earlier is given out or counted."""
        self.container.seek(pts, stream=self.stream)
        self.packets = self.discarded = self.frames = 0
        self._first_pts, self._packets_before = pts, packets_before
        self._first_shown_pts, self._early_pts = None, []

    def decoded(self) -> Iterator[VideoFrame]:
        """Every picture that can be decoded, in presentation order. Call it again after a seek."""
        for packet in self._read():
            if packet is not None and not packet.size and packet.dts is not None:
                continue  # a null frame: nothing new is shown. (Without data, it would end it all.)
            try:
                pictures = self.stream.decode(packet)
            except av.error.FFmpegError:
                self.decode_errors += 1
                continue
            for picture in pictures:
                if self._is_before(picture.pts):
                    continue
                if not self.frames:
                    self._first_shown_pts = picture.pts
                self.frames += 1
                self.damaged_frames += picture.is_corrupt
                yield picture
        self.complete = True

    def _read(self) -> Iterator[Packet[VideoStream] | None]:
        failures = 0
        while failures <= MAX_READ_ERRORS_IN_A_ROW:
            try:
                for packet in self.container.demux(self.stream):
                    if packet.size:
                        failures = 0
                        self._count(packet)
                    yield packet
                return
            except av.error.FFmpegError:
                self.read_errors += 1
                failures += 1
        yield None  # no more can be read; the decoder gives what it still holds

    def _count(self, packet: Packet[VideoStream]) -> None:
        self.damaged_packets += packet.is_corrupt
        if not self._is_before(packet.pts):
            self.packets += 1
            self.discarded += packet.is_discard
            if len(self._early_pts) < EARLY_PACKETS and packet.pts is not None:
                self._early_pts.append(packet.pts)
            if self._checksums is not None:
                self._checksums.check(bytes(packet))

    def _is_before(self, pts: int | None) -> bool:
        return self._first_pts is not None and pts is not None and pts < self._first_pts

    def losses(self, *, joins: int = 0) -> list[str]:
        """What was lost so far, one line each; empty for a sound file.

        joins: places where another recording was joined on, whose packets do not follow on.
        """
        lines = []
        missing = self._missing() if self.complete else 0
        if missing:
            lines.append(
                f"{missing} of {self.frames + missing} frames are missing or could not be decoded"
            )
        elif self.decode_errors:
            lines.append(f"the decoder refused {self.decode_errors} pieces of the video")
        if self.damaged_frames:
            lines.append(
                f"{self.damaged_frames} of {self.frames} frames are damaged in the file and were"
                " patched up by the decoder"
            )
        if self._checksums is not None and self._checksums.failed:
            lines.append(f"the checksums of {self._checksums.failed} of {self.frames} frames fail")
        if self.read_errors:
            lines.append(f"the file could not be read in {self.read_errors} places")
        damaged = self.damaged_packets - joins
        if not lines and damaged > 0:
            lines.append(f"{damaged} packets are damaged in the file")
        return lines

    @property
    def cannot_be_shown(self) -> int:
        """Pictures before the first one shown: they build upon others that were cut off."""
        first = self._first_shown_pts
        if first is None or self.decode_errors or self.read_errors or self.discarded:
            return 0
        return sum(pts < first for pts in self._early_pts)

    def _missing(self) -> int:
        """Pictures the container announces or holds that the decoder never gave."""
        if not self.one_packet_a_picture:
            return 0
        announced = max(self.announced.packets - self._packets_before, self.packets)
        return max(0, announced - self.discarded - self.frames - self.cannot_be_shown)
