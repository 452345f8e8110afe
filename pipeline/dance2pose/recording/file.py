"""Whether a file is a whole Rerun recording, told from its two ends without reading it."""

from __future__ import annotations

from pathlib import Path

from dance2pose.errors import DataError

_START_MARK = b"RRF"
# A recording ends with the place of its table of contents, marked thus.
_END_MARK = b"RRF2FOOT"
_END_BYTES = 64


def is_whole(path: Path) -> bool:
    """Whether a recording has its end, and so all that was written before it."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _END_BYTES))
        return _END_MARK in file.read()


def check_recording(path: Path) -> None:
    """Raise DataError unless `path` is a whole recording that the viewer can open."""
    if path.is_dir():
        raise DataError(f"{path}: is a folder, expected an .rrd file")
    if not path.is_file():
        raise DataError(f"{path}: no such file, expected an .rrd recording")
    try:
        with path.open("rb") as file:
            start = file.read(len(_START_MARK))
        if start != _START_MARK:
            what = f"starts with {start!r}" if start else "is empty"
            raise DataError(f"{path}: {what}, expected a Rerun recording (.rrd)")
        if path.suffix.lower() != ".rrd":
            raise DataError(
                f"{path}: is a recording, but the viewer needs a name that ends in .rrd"
            )
        if not is_whole(path):
            raise DataError(
                f"{path}: its end is missing, it was cut short in copying or downloading; copy it "
                "again or make it again (`rerun FILE` shows what is left of it)"
            )
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
