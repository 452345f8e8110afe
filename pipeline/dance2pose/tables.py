"""Tables of numbers over time (CSV, TRC) whose header and layout come back as they were."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError
from dance2pose.output_files import written_whole

# A day of 26 joints at 60 frames/s as text takes 4 GB; a take of an hour 0.2 GB.
_LARGEST_FILE = 1024**3
# Cells are Python strings: so many take 2 GB. An hour of 26 joints in space has 17 million.
_MOST_CELLS = 30_000_000
_MOST_COLUMNS = 20_000

# A column with one of these words in its name says when, who or how sure, not where.
_KEPT_WORDS = {
    *("time", "timestamp", "seconds", "frame", "frames", "person", "id", "shot", "track"),
    *("confidence", "score", "likelihood", "visibility", "presence", "valid", "interpolated"),
    *("estimated", "error", "sigma"),
}
_COUNTED = {"", "index", "coords"}  # "coords" heads the frame numbers of DeepLabCut
_KEPT_NAMES = {"t", *_COUNTED}
TIME_NAMES = {"time", "time_s", "t", "seconds", "time (s)", "time(s)", "timestamp_s"}
FRAME_NAMES = {"frame", "frames", "frame#", "frame_idx", "frame_id", "frame_index", "frame_number"}
# Rows that differ in one of these columns are of different people, takes or joints.
GROUP_NAMES = {
    *("person", "person_id", "track", "track_id", "individual", "individuals", "subject"),
    *("dancer", "shot", "id", "instance", "instance_id", "video", "scene", "take"),
    *("joint", "joint_name", "keypoint", "keypoint_name", "bodypart", "bodyparts", "landmark"),
    *("landmark_id", "landmark_index", "marker", "coordinate", "axis"),
}
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")


@dataclass(frozen=True)
class Rows:
    """The lines of a delimited text file and their cells.

    decimal: what stands before decimals; commas only where cells are separated otherwise.
    """

    path: Path
    lines: list[str]
    cells: list[list[str]]
    delimiter: str
    newline: str
    decimal: str

    def number(self, cell: str) -> float:
        """NaN for an empty cell; ValueError for what is no number."""
        text = cell.strip()
        if self.decimal == ",":
            text = text.replace(",", ".")
        return float(text) if text else math.nan

    def is_number(self, cell: str) -> bool:
        """A finite number, or NaN written out."""
        try:
            return bool(cell.strip()) and not math.isinf(self.number(cell))
        except ValueError:
            return False

    def first_data_row(self) -> int | None:
        """The first line of which at least half of the filled cells are numbers."""
        return next((i for i, row in enumerate(self.cells) if self._is_data(row)), None)

    def _is_data(self, row: list[str]) -> bool:
        filled = [cell for cell in row if cell.strip()]
        numbers = sum(self.is_number(cell) for cell in filled)
        return numbers > 0 and 2 * numbers >= len(filled)


@dataclass(frozen=True)
class MotionTable:
    """One row a frame, or a frame and person. header: its lines as they are. cells: text."""

    rows: Rows
    header: tuple[str, ...]
    names: tuple[str, ...]
    cells: list[list[str]]
    moving: tuple[int, ...]
    """Columns that hold coordinates (or other measured values)."""
    time: int | None
    """The column of times in seconds."""
    frame: int | None
    """The column of frame numbers."""
    groups: tuple[int, ...]
    """Columns that say whose row it is."""

    def values(self) -> npt.NDArray[np.float64]:
        """The moving columns, (T, columns), NaN where a cell is empty."""
        return np.array([[self.rows.number(row[c]) for c in self.moving] for row in self.cells])

    def frames(self) -> npt.NDArray[np.float64] | None:
        """(T,) frame numbers, or None where no column holds them."""
        return None if self.frame is None else self._column(self.frame)

    def times(self) -> npt.NDArray[np.float64] | None:
        """(T,) seconds, or None where no column holds them."""
        return None if self.time is None else self._column(self.time)

    def _column(self, column: int) -> npt.NDArray[np.float64]:
        return np.array([self.rows.number(row[column]) for row in self.cells])

    def members(self) -> dict[tuple[str, ...], list[int]]:
        """The rows of each person, take or joint, by the values of the group columns."""
        found: dict[tuple[str, ...], list[int]] = {}
        for n, row in enumerate(self.cells):
            found.setdefault(tuple(row[c].strip() for c in self.groups), []).append(n)
        return found


def read_table(path: Path) -> MotionTable:
    """Read a .csv, .tsv or .trc file. DataError names the file and line of what is wrong."""
    if path.suffix.lower() == ".trc":
        return _read_trc(path)
    return _read_csv(read_rows(path))


def write_table(
    path: Path, table: MotionTable, values: npt.NDArray[np.floating], *, overwrite: bool = False
) -> None:
    """Write the table with other numbers (T, columns) in its moving columns.

    Header, other columns and empty cells stay as they are. Raises OutputError.
    """
    rows = table.rows
    text = io.StringIO()
    text.writelines(line + rows.newline for line in table.header)
    writer = csv.writer(text, delimiter=rows.delimiter, lineterminator=rows.newline)
    for row, numbers in zip(table.cells, values, strict=True):
        cells = list(row)
        for column, number in zip(table.moving, numbers, strict=True):
            if not math.isnan(number):
                cells[column] = f"{number:.9g}".replace(".", rows.decimal)
        writer.writerow(cells)
    with written_whole(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(text.getvalue().encode())


def read_rows(path: Path) -> Rows:
    """The cells of a delimited text file: commas, semicolons or tabs, as its lines tell."""
    lines, newline = _lines(path)
    delimiter = _delimiter(lines)
    _check_cells(path, lines, delimiter)
    try:
        cells = list(csv.reader(lines, delimiter=delimiter, strict=True))
    except csv.Error as error:
        raise DataError(f"{path}: not a CSV file: {error}") from error
    if len(cells) != len(lines):
        raise DataError(f"{path}: a quoted cell runs over several lines, which is not supported")
    return Rows(path, lines, cells, delimiter, newline, _decimal(path, cells, delimiter))


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
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while not lines[-1].strip(" "):  # tabs are cells, if empty ones
        lines.pop()
    return lines, newline


def _delimiter(lines: list[str]) -> str:
    """What the first line is separated by; a comma only where no line has semicolons or tabs."""
    for line in lines[:10]:
        for candidate in "\t;":
            if candidate in line:
                return candidate
    return ","


def _check_cells(path: Path, lines: list[str], delimiter: str) -> None:
    widest = max(line.count(delimiter) for line in lines) + 1
    if widest > _MOST_COLUMNS:
        raise DataError(f"{path}: has {widest} columns, expected at most {_MOST_COLUMNS}")
    cells = sum(line.count(delimiter) + 1 for line in lines)
    if cells > _MOST_CELLS:
        raise DataError(f"{path}: has {cells} cells, expected at most {_MOST_CELLS}; split it")


def _decimal(path: Path, cells: list[list[str]], delimiter: str) -> str:
    if delimiter == ",":
        return "."
    commas = points = False
    for row in cells[:1000]:
        commas |= any(_DECIMAL_COMMA.fullmatch(cell) for cell in row)
        points |= any(re.fullmatch(r"\s*[-+]?\d*\.\d+\s*", cell) for cell in row)
    if commas and points:
        raise DataError(f"{path}: numbers have decimal commas and decimal points; expected one")
    return "," if commas else "."


def _read_csv(rows: Rows) -> MotionTable:
    path, start = rows.path, rows.first_data_row()
    if start is None:
        raise DataError(f"{path}: no line holds numbers")
    if start == 0:
        raise DataError(f"{path}:1: expected a header line that names the columns")
    names = tuple(cell.strip() for cell in rows.cells[start - 1])
    cells = _filled(rows.cells[start:], len(names))
    _check_widths(path, cells, start + 1, len(names))
    lower = [name.lower() for name in names]
    moving = tuple(
        c
        for c, name in enumerate(names)
        if not _is_kept(name)
        and name.lower() not in GROUP_NAMES
        and _first_is_number(rows, cells, c)
        and not (c == 0 and _counts(rows, cells))
    )
    if not moving:
        raise DataError(f"{path}: no column of numbers beside {', '.join(names) or 'nothing'}")
    time = next((c for c, name in enumerate(lower) if name in TIME_NAMES), None)
    frame = next((c for c, name in enumerate(lower) if name in FRAME_NAMES), None)
    if frame is None and lower[0] in _COUNTED and _counts(rows, cells):
        frame = 0
    groups = tuple(c for c, name in enumerate(lower) if name in GROUP_NAMES and _repeats(cells, c))
    table = MotionTable(rows, tuple(rows.lines[:start]), names, cells, moving, time, frame, groups)
    _check_numbers(table, start + 1)
    return table


def _read_trc(path: Path) -> MotionTable:
    lines, newline = _lines(path)
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
    _check_cells(path, lines, "\t")
    start = 6 if len(lines) > 5 and not lines[5].strip() else 5
    width = 2 + 3 * markers
    cells = _filled([line.split("\t") for line in lines[start:]], width)
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
    rows = Rows(path, lines, cells, "\t", newline, _decimal(path, cells, "\t"))
    moving = tuple(range(2, width))
    table = MotionTable(rows, tuple(lines[:start]), names, cells, moving, 1, 0, ())
    _check_numbers(table, start + 1)
    return table


def _filled(cells: list[list[str]], width: int) -> list[list[str]]:
    """Rows without the one delimiter too many that some tools end them with."""
    return [row[:-1] if len(row) == width + 1 and not row[-1].strip() else row for row in cells]


def _check_widths(path: Path, cells: list[list[str]], first_line: int, width: int) -> None:
    if not cells:
        raise DataError(f"{path}: has a header and no frame")
    for number, row in enumerate(cells, start=first_line):
        if len(row) != width:
            blank = " (the line is blank)" if not "".join(row).strip() else ""
            raise DataError(f"{path}:{number}: has {len(row)} cells, expected {width}{blank}")


def _check_numbers(table: MotionTable, first_line: int) -> None:
    """Every moving cell a number or empty; every clock a number that increases in each group."""
    rows = table.rows
    for number, row in enumerate(table.cells, start=first_line):
        for column in table.moving:
            if row[column].strip() and not rows.is_number(row[column]):
                raise DataError(
                    f"{rows.path}:{number}: {row[column].strip()[:40]!r} in column"
                    f" {table.names[column]!r} is not a finite number; leave missing cells empty"
                )
    for column in [c for c in (table.time, table.frame) if c is not None]:
        for members in table.members().values():
            _check_clock(table, column, members, first_line)


def _check_clock(table: MotionTable, column: int, members: list[int], first_line: int) -> None:
    last = -math.inf
    for n in members:
        cell = table.cells[n][column]
        here = table.rows.number(cell) if table.rows.is_number(cell) else math.nan
        if not here > last:
            whose = " and person (a column such as person or track)" if not table.groups else ""
            raise DataError(
                f"{table.rows.path}:{n + first_line}: {table.names[column]} is"
                f" {cell.strip()[:40]!r}, expected more than in the row before;"
                f" a table has one row a frame{whose}"
            )
        last = here


def _is_kept(name: str) -> bool:
    words = set(re.split(r"[^a-z0-9]+", name.lower()))
    return name.lower() in _KEPT_NAMES or not words.isdisjoint(_KEPT_WORDS)


def _first_is_number(rows: Rows, cells: list[list[str]], column: int) -> bool:
    first = next((row[column] for row in cells if row[column].strip()), "")
    return rows.is_number(first)


def _repeats(cells: list[list[str]], column: int) -> bool:
    """Whether values come back, as names do and counts do not."""
    return len({row[column] for row in cells}) < len(cells)


def _counts(rows: Rows, cells: list[list[str]]) -> bool:
    """Whether the first column counts the rows: whole numbers that always increase."""
    if not all(re.fullmatch(r"\s*\d+(\.0*)?\s*", row[0]) for row in cells):
        return False
    numbers = [rows.number(row[0]) for row in cells]
    return all(later > earlier for earlier, later in pairwise(numbers))
