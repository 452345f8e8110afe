"""Results into a Rerun recording (.rrd): written as a stream, complete or absent.

The picture goes out while the video is read; the dancers, the provenance and the blueprint at the
end. Memory holds one batch of pictures and the poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
import pyarrow as pa

from dance2pose.errors import OutputError
from dance2pose.output_files import written_whole
from dance2pose.portions import portions, timeline_rows
from dance2pose.poses import Dancer, Frame, Timeline
from dance2pose.provenance import Provenance
from dance2pose.recording.entities import (
    PICTURE,
    PROVENANCE,
    piece_path,
    send_dancer,
    time_columns,
)
from dance2pose.recording.file import is_whole
from dance2pose.recording.layout import blueprint
from dance2pose.recording.picture import (
    PictureChoice,
    PictureMode,
    choose_picture,
    encode_jpeg,
)
from dance2pose.recording.pieces import References, pieces
from dance2pose.recording.placement import place
from dance2pose.recording.quiet_rerun import rr
from dance2pose.recording.stream import open_stream
from dance2pose.recording.style import send_style

if TYPE_CHECKING:
    from dance2pose.video import VideoInfo

__all__ = [
    "PictureChoice",
    "RecordingWriter",
    "choose_picture",
]

APPLICATION_ID = "dance2pose"
# A batch of pictures is written out when it has this many bytes.
_BATCH_BYTES = 4_000_000


class RecordingWriter:
    """Writes one recording; use it as a context manager.

    Within it, call `picture_frame` with every processed frame in order, then `write` once. The
    file appears when the block ends well; after any error there is none. reason: why the picture
    is recorded as it is, for the provenance. Raises OutputError for what the file system refuses,
    VideoError where `picture` is video and it cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        *,
        recording_id: str,
        picture: PictureMode,
        video: VideoInfo,
        reason: str = "",
        overwrite: bool = False,
    ) -> None:
        self._path = path
        self._recording_id = recording_id
        self._picture = picture
        self._reason = reason
        self._video = video
        self._overwrite = overwrite
        self._frames: list[int] = []
        self._times: list[float] = []
        self._pictures: list[bytes] = []
        self._references = References()
        self._written = False

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            temporary = stack.enter_context(written_whole(self._path, overwrite=self._overwrite))
            self._temporary = temporary
            # Else Rerun would leave out what it cannot record, with no more than a warning.
            stack.callback(rr.set_strict_mode, rr.strict_mode())
            rr.set_strict_mode(True)
            self._file = stack.enter_context(
                open_stream(
                    temporary, application_id=APPLICATION_ID, recording_id=self._recording_id
                )
            )
            self._stream = self._file.rerun
            self._stream.send_recording_name(self._video.path.name)
            if self._picture == "video":
                self._send_video()
            self._exit = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._exit.__exit__(kind, error, trace)
            return
        with self._exit:
            if not self._written:
                raise RuntimeError(f"{self._path}: RecordingWriter.write was not called")
            self._file.close()
            if not is_whole(self._temporary):
                raise OutputError(f"{self._path}: could not be written whole; nothing was left")

    def picture_frame(self, frame: Frame) -> None:
        """Take the next processed frame, whose picture is kept where frames are recorded."""
        if not self.records_frames:
            return
        self._pictures.append(encode_jpeg(frame.image))
        self._frames.append(frame.index)
        self._times.append(frame.time_s)
        if sum(map(len, self._pictures)) >= _BATCH_BYTES:
            self._send_pictures()

    @property
    def picture(self) -> str:
        """How the picture is recorded, and why."""
        return f"{self._picture} ({self._reason})" if self._reason else self._picture

    @property
    def records_frames(self) -> bool:
        """Whether the pictures of frames are recorded, so that `picture_frame` wants them."""
        return self._picture == "frames"

    def write(self, dancers: Sequence[Dancer], provenance: Provenance, timeline: Timeline) -> None:
        """Write the dancers (none is allowed), the provenance and the layout.

        timeline: every processed frame.
        """
        self._send_pictures()
        placement = place(dancers)
        if len(self._references):
            for rows in portions(len(timeline)):
                part = timeline_rows(timeline, rows)
                self._send(part, self._video_references(part))
        send_style(self._stream, dancers, placement)
        for dancer in dancers:
            send_dancer(self._stream, dancer, timeline, self._file.flush)
        stages = dict(provenance.stages)
        if self._reason:
            stages["picture"] = f"{self._picture}: {self._reason}"
        if placement.notes:
            stages["placement"] = " ".join(placement.notes)
        provenance = replace(provenance, stages=stages)
        self._write_provenance(provenance)
        size = (self._video.width, self._video.height)
        self._stream.send_blueprint(blueprint(dancers, placement, size))
        self._written = True

    def _send_video(self) -> None:
        """The file, piece by piece: no more than one is held."""
        for number, piece in enumerate(pieces(self._video.path, self._video.track)):
            self._references.add(piece)
            self._stream.log(piece_path(number), piece.asset, static=True)
            self._file.flush()

    def _video_references(self, timeline: Timeline) -> rr.ComponentColumnList:
        number, timestamps_ns = self._references.of(timeline.time_s)
        return rr.VideoFrameReference.columns(
            timestamp=timestamps_ns,
            video_reference=[piece_path(n) for n in number],
        )

    def _send_pictures(self) -> None:
        if not self._pictures:
            return
        columns = rr.EncodedImage.columns(
            blob=self._pictures, media_type=["image/jpeg"] * len(self._pictures)
        )
        self._send(Timeline(np.array(self._frames, np.int64), np.array(self._times)), columns)
        self._pictures, self._frames, self._times = [], [], []
        self._file.flush()

    def _write_provenance(self, provenance: Provenance) -> None:
        text = rr.TextDocument(provenance.to_markdown(), media_type=rr.MediaType.MARKDOWN)
        self._stream.log(PROVENANCE, text, static=True)
        for group, values in provenance.to_properties().items():
            # Typed arrays: else the first value of a name decides its type for the whole process.
            arrays = {name: pa.array([value]) for name, value in values.items()}
            self._stream.send_property(group, rr.AnyValues(drop_untyped_nones=True, **arrays))

    def _send(self, timeline: Timeline, columns: rr.ComponentColumnList) -> None:
        rr.send_columns(PICTURE, time_columns(timeline), columns, recording=self._stream)
