"""A Rerun recording stream into a file, with errors that can be trusted.

Rerun writes files on a thread of its own. Where the disk is full that thread ends with a line on
stderr, and the next flush or disconnect can wait for it for ever (rerun-sdk 0.41). So Rerun is
given one end of a pipe, and the file is written here: it can fail, and be waited for, as any file.
A pipe also holds Rerun back while the disk is slow, so that memory stays bounded.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from dance2pose.recording.quiet_rerun import rr

# Where a pipe can be opened by name. Windows has none; there Rerun writes the file itself.
_PIPES = Path("/dev/fd")
_READ_BYTES = 1 << 20


class FileStream:
    """An open recording (`rerun`) and the file it goes to; made by `open_stream`."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.rerun = stream
        self._error: OSError | None = None
        self._writer: threading.Thread | None = None

    def flush(self) -> None:
        """Wait until all that was sent is on its way to the file, and let go of the memory that it
        took. Raises OSError if it fails."""
        try:
            self.rerun.flush()
        except RuntimeError as error:
            raise OSError(str(error)) from error
        pa.default_memory_pool().release_unused()  # which would be kept for the next columns
        self._check()

    def close(self) -> None:
        """End the recording and the file. May be called twice. Raises OSError if writing failed."""
        self.rerun.disconnect()
        if self._writer is not None:
            self._writer.join()
        self._check()

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

    def _open(self, path: Path) -> None:
        if not _PIPES.is_dir():
            self.rerun.save(path)
            return
        outlet, inlet = os.pipe()
        try:
            self._writer = threading.Thread(target=self._write, args=(path, outlet), daemon=True)
            self._writer.start()
            self.rerun.save(_PIPES / str(inlet))
        finally:
            os.close(inlet)

    def _write(self, path: Path, outlet: int) -> None:
        """In the writing thread: the pipe into the file, and into nothing once that has failed."""
        with open(outlet, "rb", buffering=0) as pipe:
            try:
                with path.open("wb") as file:
                    while data := pipe.read(_READ_BYTES):
                        file.write(data)
            except OSError as error:
                self._error = error
                while pipe.read(_READ_BYTES):
                    pass


@contextlib.contextmanager
def open_stream(path: Path, *, application_id: str, recording_id: str) -> Iterator[FileStream]:
    """A recording that is written to `path`; closed at the end, whatever happens."""
    stream = FileStream(rr.RecordingStream(application_id, recording_id=recording_id))
    try:
        stream._open(path)
        yield stream
    except BaseException:
        with contextlib.suppress(OSError):
            stream.close()
        raise
    stream.close()
