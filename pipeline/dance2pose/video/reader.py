"""Reading a video: the file's pictures, each with its index and time, as frames."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Literal

import av.error
from av.video.frame import VideoFrame

from dance2pose.errors import UsageError, VideoError
from dance2pose.poses import Frame
from dance2pose.profiling import stage_of_each
from dance2pose.video.announced import tagged_length_s
from dance2pose.video.background import Background
from dance2pose.video.clock import make_clock
from dance2pose.video.deinterlace import Deinterlacer, Timed
from dance2pose.video.info import VideoInfo, describe
from dance2pose.video.interlacing import find_interlacing
from dance2pose.video.picture import Orientation, PictureMaker, orientation
from dance2pose.video.pixel_shape import PixelShapes
from dance2pose.video.seeking import LEAST_SKIP_S, find_entry
from dance2pose.video.source import MAX_PIXELS, Source
from dance2pose.video.unreadable import why_undecodable

Deinterlace = Literal["auto", "off"]

# A stream that ends earlier than it announces by less than this is rounding, not loss.
LEAST_SHORT_S = 0.5


def open_video(
    path: str | Path,
    *,
    start_s: float | None = None,
    end_s: float | None = None,
    every: int = 1,
    deinterlace: Deinterlace = "auto",
) -> FrameReader:
    """Open a video for reading from front to back. Use it as a context manager.

    start_s, end_s: read the frames with start_s <= time < end_s (seconds from the start of the
    video). every: read each n-th of these. deinterlace: "auto" where fields are found, or "off".

    Raises VideoError where there is no video to read, UsageError for a range that cannot be.
    """
    if start_s is not None and not start_s >= 0:
        raise UsageError(f"start is {start_s} s, expected 0 or more")
    if end_s is not None and not end_s > (start_s or 0):
        raise UsageError(f"end is {end_s} s, expected more than the start ({start_s or 0} s)")
    if every < 1:
        raise UsageError(f"every is {every}, expected 1 (each frame) or more")
    if deinterlace not in ("auto", "off"):
        raise UsageError(f"deinterlace is {deinterlace!r}, expected 'auto' or 'off'")
    return FrameReader(Path(path), start_s, end_s, every, deinterlace)


class FrameReader:
    """An open video; made by `open_video`. Iterate it once.

    info: the file described. warnings: what was lost or supposed, complete once the reading has
    ended. damaged: True where frames were lost or patched up. deinterlaced: True once a picture
    went through the deinterlacer. frames_read: frames given out so far.
    """

    def __init__(
        self,
        path: Path,
        start_s: float | None,
        end_s: float | None,
        every: int,
        deinterlace: Deinterlace,
    ) -> None:
        self._start_s = start_s or 0.0
        self._end_s = end_s if end_s is not None else float("inf")
        self._every = every
        self.warnings: list[str] = []
        self.damaged = False
        self.frames_read = 0
        self._background: Background[Frame] | None = None
        self._source = Source(path)
        try:
            decoded = self._source.decoded()
            first = _first(decoded, self._source)
            interlacing = find_interlacing(self._source, first)
            self.info: VideoInfo = describe(self._source, first, orientation(first), interlacing)
            stream = self._source.stream
            self._clock = make_clock(stream, first)
            self._maker = PictureMaker(self.info.size)
            self._shapes = PixelShapes(stream)
            self._deinterlacer = Deinterlacer(interlacing) if deinterlace == "auto" else None
            self._pictures = self._skip_to_start() or enumerate(chain([first], decoded))
        except BaseException:
            self._source.close()
            raise

    def _skip_to_start(self) -> Iterator[tuple[int, VideoFrame]] | None:
        """The numbered pictures from shortly before the start, where seeking is worth it and the
        numbers stay true; None to decode from the beginning."""
        target = self._clock.pts(self._start_s)
        if self._start_s < LEAST_SKIP_S or target is None or self._clock.by_decoding:
            return None
        entry = find_entry(self.info.path, self.info.track, target)
        if entry is None or entry.index == 0:
            return None
        with contextlib.suppress(av.error.FFmpegError):  # not every file can be sought in
            self._source.seek(entry.pts, entry.packets_before)
            pictures = self._source.decoded()
            first = next(pictures, None)
            if first is not None and first.pts == entry.pts:
                return enumerate(chain([first], pictures), start=entry.index)
        self._source.close()  # landed elsewhere: begin again
        self._source = Source(self.info.path, track=self.info.track)
        self._shapes.follow(self._source.stream)
        return enumerate(self._source.decoded())

    @property
    def deinterlaced(self) -> bool:
        return self._deinterlacer is not None and self._deinterlacer.applied > 0

    @property
    def expected_frames(self) -> int | None:
        """How many frames the reading will give if the container tells the truth; for progress."""
        info = self.info
        count, duration_s = info.frame_count, info.duration_s
        if count is None and duration_s and info.frame_rate:
            count = round(duration_s * info.frame_rate)
        if count is None:
            return None
        if duration_s:
            end_s = min(self._end_s, duration_s)
            count = round(count * max(0.0, end_s - self._start_s) / duration_s)
        return -(-count // self._every)

    def __enter__(self) -> FrameReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop reading and let the file go. May be called twice."""
        if self._background is not None:
            self._background.close()
        self._source.close()

    def __iter__(self) -> Iterator[Frame]:
        if self._background is not None:
            raise RuntimeError("a video is read once; open it again")
        self._background = Background(stage_of_each("decode", self._frames()))
        for frame in self._background:
            self.frames_read += 1
            yield frame

    def _frames(self) -> Iterator[Frame]:
        """In the background thread: the wanted frames, then the account of what was lost."""
        wanted = 0
        try:
            for timed in self._progressive():
                if timed.time_s < self._start_s:
                    continue
                if wanted % self._every == 0:
                    shown = timed.picture, timed.orientation, timed.aspect
                    image, inner = self._maker.image(*shown)
                    small = self._maker.small(*shown)
                    yield Frame(timed.index, timed.time_s, image, inner, small)
                wanted += 1
        except av.error.FFmpegError as error:
            raise VideoError(
                f"{self.info.path}: a frame after {self._clock.end_s:.2f} s cannot be turned into a"
                f" picture ({error.strerror}); convert the video, or name an earlier end"
            ) from None
        self._account()
        if not wanted:
            until = f"to {self._end_s:g} s" if self._end_s < float("inf") else "on"
            raise VideoError(
                f"{self.info.path}: has no frame from {self._start_s:g} s {until}; the last one"
                f" read is at {self._clock.last_s or 0.0:.2f} s"
            )

    def _timed(self) -> Iterator[Timed]:
        turned = Orientation()
        for number, (index, picture) in enumerate(self._pictures):
            time_s = self._clock.read(picture)
            if time_s >= self._end_s:
                return
            if number == 0 or picture.key_frame:
                turned = orientation(picture)
            yield Timed(index, time_s, picture, turned, self._shapes.of(picture))

    def _progressive(self) -> Iterator[Timed]:
        if self._deinterlacer is None:
            yield from self._timed()
            return
        for timed in self._timed():
            yield from self._deinterlacer.push(timed)
        yield from self._deinterlacer.flush()

    def _account(self) -> None:
        """Say what was lost and what was supposed."""
        source, info, clock = self._source, self.info, self._clock
        losses = source.losses(joins=clock.restarts)
        announced_s = tagged_length_s(source.stream)
        if source.complete and not losses and announced_s is not None:
            short_s = announced_s - clock.end_s
            if short_s > max(LEAST_SHORT_S, 2 * clock.period_s):
                losses.append(
                    f"the video ends after {clock.end_s:.2f} s, the file announces"
                    f" {announced_s:.2f} s: its end is missing"
                )
        self.damaged = bool(losses)
        self.warnings += losses + clock.warnings()
        if info.other_tracks:
            self.warnings.append(
                f"of several video tracks, track {info.track} was read; left out:"
                f" {', '.join(info.other_tracks)}"
            )
        if source.cannot_be_shown:
            self.warnings.append(
                f"the video begins with {source.cannot_be_shown} frames that build upon frames cut"
                " off before: they cannot be shown"
            )
        if self._maker.refitted:
            self.warnings.append(
                f"{self._maker.refitted} frames have another size or shape than the first: fitted"
                f" into {info.width} x {info.height} px with black borders"
            )
        if info.hdr:
            self.warnings.append(
                f"the video has a high dynamic range ({info.hdr}): its colours are shown flat"
            )


def _first(decoded: Iterator[VideoFrame], source: Source) -> VideoFrame:
    first = next(decoded, None)
    if first is not None:
        return first
    context = source.stream.codec_context
    if not source.packets or not context.width * context.height:
        why = why_undecodable(source.path)
        if why is not None and "codec is" not in why:
            raise VideoError(f"{source.path}: {why}")
    if not context.width * context.height:
        raise VideoError(
            f"{source.path}: says no picture size, or one of more than {MAX_PIXELS} px in all; its"
            " header is damaged, or the video must be made smaller first"
        )
    raise VideoError(
        f"{source.path}: holds no frame that can be decoded (codec"
        f" {context.codec.canonical_name}, {source.packets} packets, {source.decode_errors}"
        " refused by the decoder); copy it again, or convert it"
    )
