"""Which videos a collection holds: a folder, a list of names, or a table with metadata."""

from __future__ import annotations

import csv
import os
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from dance2pose.errors import DataError, UsageError

# A file in a folder is taken for a video by its name; whether it is one shows when it is opened.
VIDEO_SUFFIXES = frozenset(
    ".3g2 .3gp .asf .avi .divx .dv .f4v .flv .m1v .m2t .m2ts .m2v .m4v .mkv .mov .mp4 .mpe .mpeg "
    ".mpg .mts .mxf .ogm .ogv .qt .rm .rmvb .ts .vob .webm .wmv .y4m".split()
)
_LARGEST_TABLE = 256 * 1024**2
FILENAME = "filename"


@dataclass(frozen=True)
class Entry:
    """One video as it was found. name: as a person reads it, relative to the source.

    overrides: settings of this video alone, by the names of the options. metadata: every column
    of the table as given, `filename` included; a single one where there was no table.
    """

    path: Path
    name: str
    overrides: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, str] = field(default_factory=dict)


def find_entries(
    source: Path, *, settings: frozenset[str] = frozenset(), leave_out: Path | None = None
) -> list[Entry]:
    """The videos of a folder, a list file, or a CSV table, in a fixed order.

    settings: the column names that are settings of a video. leave_out: a folder that is not
    walked into (the archive itself, should it lie in the source).

    Raises UsageError for a source that is none of the three, DataError for a damaged table.
    """
    if source.is_dir():
        return list(_walk(source, leave_out))
    if not source.exists():
        raise UsageError(f"{source}: no such folder, list or table of videos")
    if not source.is_file():
        raise UsageError(f"{source}: expected a folder, a list file or a CSV table")
    suffix = source.suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        raise UsageError(f"{source}: is one video; for it alone: dance2pose VIDEO")
    if suffix in (".csv", ".tsv"):
        return _read_csv(source, settings)
    return _read_list(source)


def _walk(folder: Path, leave_out: Path | None) -> Iterator[Entry]:
    left_out = leave_out.resolve() if leave_out else None

    def refuse(error: OSError) -> None:
        raise DataError(f"{error.filename}: cannot be read: {error.strerror}") from error

    for place, folders, files in os.walk(folder, onerror=refuse):
        folders[:] = sorted(
            f for f in folders if not f.startswith(".") and Path(place, f).resolve() != left_out
        )
        for file in sorted(files):
            if Path(file).suffix.lower() in VIDEO_SUFFIXES and not file.startswith("."):
                path = Path(place, file)
                yield _plain_entry(path, readable(path.relative_to(folder)))


def _plain_entry(path: Path, name: str) -> Entry:
    return Entry(path, name, {}, {FILENAME: name})


def _read_list(source: Path) -> list[Entry]:
    lines = [line.strip("\r") for line in _text(source).split("\n")]
    named = [line for line in lines if line.strip() and not line.startswith("#")]
    if not named:
        raise DataError(f"{source}: names no video; expected one file name a line")
    return [_plain_entry(source.parent / line, line) for line in named]


def _read_csv(source: Path, settings: frozenset[str]) -> list[Entry]:
    text = _text(source)
    first = text.partition("\n")[0]
    rows = csv.reader(text.splitlines(keepends=True), delimiter=max(",;\t", key=first.count))
    try:
        header = [name.strip() for name in next(rows)]
        _check_header(source, header)
        return [
            _row_entry(source, header, row, rows.line_num, settings)
            for row in rows
            if any(cell.strip() for cell in row)
        ]
    except StopIteration:
        raise DataError(f"{source}: the table is empty") from None
    except csv.Error as error:
        raise DataError(f"{source}: not a CSV table: {error}") from error


def _check_header(source: Path, header: list[str]) -> None:
    if FILENAME not in header:
        raise DataError(
            f"{source}:1: has no column {FILENAME!r}; its columns: {', '.join(header)[:200]}"
        )
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise DataError(f"{source}:1: names a column twice: {', '.join(sorted(twice))}")


def _row_entry(
    source: Path, header: list[str], row: list[str], line: int, settings: frozenset[str]
) -> Entry:
    if len(row) != len(header):
        raise DataError(f"{source}:{line}: has {len(row)} cells, expected {len(header)}")
    cells = dict(zip(header, row, strict=True))
    name = cells[FILENAME]
    if not name.strip() or "\0" in name:
        raise DataError(f"{source}:{line}: the column {FILENAME!r} names no file")
    overrides = {
        column: cell.strip()
        for column, cell in cells.items()
        if column in settings and cell.strip()
    }
    return Entry(source.parent / name, name, overrides, cells)


def _text(source: Path) -> str:
    try:
        if source.stat().st_size > _LARGEST_TABLE:
            raise DataError(f"{source}: too large for a list of videos")
        return source.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise DataError(f"{source}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{source}: not a text file (UTF-8): {error}") from error


def readable(path: Path) -> str:
    """The name of a file as text that can be written anywhere, whatever bytes it has."""
    return str(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def why_unreadable(path: Path, *, status: Callable[[Path], os.stat_result] = os.stat) -> str | None:
    """Why a source cannot be processed, found without opening it; None where nothing is known."""
    try:
        found = status(path)
    except (OSError, ValueError) as error:
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if stat.S_ISDIR(found.st_mode):
        return "is a folder, expected a video file"
    if not stat.S_ISREG(found.st_mode):
        return "is a pipe, socket or device, expected a file"
    if not os.access(path, os.R_OK):
        return "cannot be read: permission denied"
    return None
