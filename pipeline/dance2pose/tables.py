"""Tables of numbers over time (CSV, TRC) whose header and layout come back as they were."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError
from dance2pose.output_files import written_whole

# A day of 26 joints at 60 frames/s as text takes 4 GB; a take of an hour 0.2 GB.
_LARGEST_FILE = 1024**3

# A column with one of these words in its name says when, who or how sure, not where.
_KEPT_WORDS = {
    *("time", "timestamp", "seconds", "frame", "frames", "person", "id", "shot", "track"),
    *("confidence", "score", "likelihood", "visibility", "presence", "valid", "interpolated"),
    *("estimated", "error", "sigma"),
}
_KEPT_NAMES = {"", "t", "index", "coords"}  # "coords" heads the frame numbers of DeepLabCut
_TIME_NAMES = {"time", "time_s", "t", "seconds", "time (s)", "time(s)", "timestamp_s"}


@dataclass(frozen=True)
class Table:
    """One row a frame. header: its lines as they are. names: of the columns. cells: text."""

    path: Path
    header: tuple[str, ...]
    names: tuple[str, ...]
    cells: list[list[str]]
    delimiter: str
    newline: str
    moving: tuple[int, ...]
    """Columns that hold coordinates (or other measured values)."""
    time: int | None
    """The column of times in seconds."""

    def values(self) -> npt.NDArray[np.float64]:
        """The moving columns, (T, columns), NaN where a cell is empty."""
        return np.array([[_number(row[c]) for c in self.moving] for row in self.cells])

    def times(self) -> npt.NDArray[np.float64] | None:
        """(T,) seconds, or None where no column holds them."""
        if self.time is None:
            return None
        return np.array([_number(row[self.time]) for row in self.cells])


def read_table(path: Path) -> Table:
    """Read a .csv or .trc file. DataError names the file and line of what is wrong."""
    lines, newline = _lines(path)
    if path.suffix.lower() == ".trc":
        return _read_trc(path, lines, newline)
    return _read_csv(path, lines, newline)


def write_table(
    path: Path, table: Table, values: npt.NDArray[np.floating], *, overwrite: bool = False
) -> None:
    """Write the table with other numbers (T, columns) in its moving columns.

    Header, other columns and empty cells stay as they are. Raises OutputError.
    """
    text = io.StringIO()
    text.writelines(line + table.newline for line in table.header)
    writer = csv.writer(text, delimiter=table.delimiter, lineterminator=table.newline)
    for row, numbers in zip(table.cells, values, strict=True):
        cells = list(row)
        for column, number in zip(table.moving, numbers, strict=True):
            if not math.isnan(number):
                cells[column] = f"{number:.9g}"
        writer.writerow(cells)
    with written_whole(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(text.getvalue().encode())


def _lines(path: Path) -> tuple[list[str], str]:
    try:
        size = path.stat().st_size
        if size > _LARGEST_FILE:
            raise DataError(f"{path}: {size / 1e9:.1f} GB are too much for one table; split it")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: not a text file (UTF-8): {error}") from error
    if not text.strip():
        raise DataError(f"{path}: the file is empty")
    newline = "\r\n" if "\r\n" in text else "\n"
    return text.rstrip().splitlines(), newline


def _read_csv(path: Path, lines: list[str], newline: str) -> Table:
    delimiter = max(",;\t", key=lines[0].count)
    try:
        rows = list(csv.reader(lines, delimiter=delimiter, strict=True))
    except csv.Error as error:
        raise DataError(f"{path}: not a CSV file: {error}") from error
    if len(rows) != len(lines):
        raise DataError(f"{path}: a quoted cell runs over several lines, which is not supported")
    start = next((i for i, row in enumerate(rows) if _is_data(row)), None)
    if start is None:
        raise DataError(f"{path}: no line holds numbers")
    if start == 0:
        raise DataError(f"{path}:1: expected a header line that names the columns")
    names = tuple(cell.strip() for cell in rows[start - 1])
    cells = rows[start:]
    _check_widths(path, cells, start + 1, len(names))
    moving = tuple(
        c
        for c, name in enumerate(names)
        if not _is_kept(name) and _first_is_number(cells, c) and not (c == 0 and _counts(cells))
    )
    if not moving:
        raise DataError(f"{path}: no column of numbers beside {', '.join(names) or 'nothing'}")
    time = next((c for c, name in enumerate(names) if name.lower() in _TIME_NAMES), None)
    table = Table(path, tuple(lines[:start]), names, cells, delimiter, newline, moving, time)
    clocks = [c for c, name in enumerate(names) if name.lower() in {*_TIME_NAMES, "frame"}]
    _check_numbers(table, start + 1, clocks)
    return table


def _read_trc(path: Path, lines: list[str], newline: str) -> Table:
    if not lines[0].startswith("PathFileType"):
        raise DataError(f"{path}:1: expected PathFileType, the first word of a TRC file")
    settings = dict(
        zip(*([c.strip() for c in line.split("\t")] for line in lines[1:3]), strict=False)
    )
    try:
        frames, markers = int(settings["NumFrames"]), int(settings["NumMarkers"])
        labels = [cell.strip() for cell in lines[3].split("\t")]
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(f"{path}:3: expected NumFrames and NumMarkers as whole numbers") from error
    if labels[:2] != ["Frame#", "Time"]:
        raise DataError(f"{path}:4: expected the columns Frame# and Time and the marker names")
    start = 6 if len(lines) > 5 and not lines[5].strip() else 5
    width = 2 + 3 * markers
    cells = [line.split("\t") for line in lines[start:]]
    cells = [row[:-1] if len(row) == width + 1 and not row[-1].strip() else row for row in cells]
    _check_widths(path, cells, start + 1, width)
    if len(cells) != frames:
        raise DataError(
            f"{path}: holds {len(cells)} frames, its header says {frames}; is it truncated?"
        )
    marker_names = [label for label in labels[2:] if label]
    if len(marker_names) != markers:
        raise DataError(
            f"{path}:4: names {len(marker_names)} markers, line 3 says NumMarkers {markers}"
        )
    names = ("Frame#", "Time", *(f"{m} {axis}" for m in marker_names for axis in "XYZ"))
    moving = tuple(range(2, width))
    table = Table(path, tuple(lines[:start]), names, cells, "\t", newline, moving, 1)
    _check_numbers(table, start + 1, [0, 1])
    return table


def _check_widths(path: Path, cells: list[list[str]], first_line: int, width: int) -> None:
    if not cells:
        raise DataError(f"{path}: has a header and no frame")
    for number, row in enumerate(cells, start=first_line):
        if len(row) != width:
            raise DataError(f"{path}:{number}: has {len(row)} cells, expected {width}")


def _check_numbers(table: Table, first_line: int, clocks: Sequence[int]) -> None:
    """Every moving cell a number or empty; every clock a number that increases."""
    for number, row in enumerate(table.cells, start=first_line):
        for column in table.moving:
            if not _is_number(row[column]) and row[column].strip():
                raise DataError(
                    f"{table.path}:{number}: {row[column].strip()[:40]!r} in column"
                    f" {table.names[column]!r} is not a finite number; leave missing cells empty"
                )
    for column in clocks:
        last = -math.inf
        for number, row in enumerate(table.cells, start=first_line):
            here = _number(row[column]) if _is_number(row[column]) else math.nan
            if not here > last:
                raise DataError(
                    f"{table.path}:{number}: {table.names[column]} is"
                    f" {row[column].strip()[:40]!r}, expected more than the line before;"
                    " a table has one row a frame"
                )
            last = here


def _is_kept(name: str) -> bool:
    words = set(re.split(r"[^a-z0-9]+", name.lower()))
    return name.lower() in _KEPT_NAMES or not words.isdisjoint(_KEPT_WORDS)


def _is_data(row: list[str]) -> bool:
    """A line is data where at least half of its filled cells are numbers."""
    filled = [cell for cell in row if cell.strip()]
    numbers = sum(_is_number(cell) for cell in filled)
    return numbers > 0 and 2 * numbers >= len(filled)


def _first_is_number(cells: list[list[str]], column: int) -> bool:
    first = next((row[column] for row in cells if row[column].strip()), "")
    return _is_number(first)


def _counts(cells: list[list[str]]) -> bool:
    """Whether the first column counts the rows: whole numbers that always increase."""
    if not all(re.fullmatch(r"\s*\d+(\.0*)?\s*", row[0]) for row in cells):
        return False
    numbers = [float(row[0]) for row in cells]
    return all(later > earlier for earlier, later in pairwise(numbers))


def _is_number(cell: str) -> bool:
    """A finite number, or NaN written out."""
    try:
        return not math.isinf(float(cell))
    except ValueError:
        return False


def _number(cell: str) -> float:
    return float(cell) if cell.strip() else math.nan
