"""DeepLabCut's predictions: CSV with three or four header lines, and the .h5 beside it."""

from __future__ import annotations

import pickletools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting
from dance2pose.reading.h5_files import read_dataset
from dance2pose.reading.json_files import whole_number
from dance2pose.tables import Rows

_HEADS = ("scorer", "individuals", "bodyparts", "coords")


def is_deeplabcut(rows: Rows) -> bool:
    heads = [row[0].strip().lower() for row in rows.cells[:4] if row]
    return "bodyparts" in heads and "coords" in heads


def read_deeplabcut(path: Path, rows: Rows) -> Content:
    """A row a frame; its first cell is the frame number or the picture's name."""
    heads = {row[0].strip().lower(): row for row in rows.cells[:4] if row}
    count = len([head for head in heads if head in _HEADS])
    parts, coordinates = heads["bodyparts"][1:], heads["coords"][1:]
    who = heads.get("individuals", ["", *[""] * len(parts)])[1:]
    lead = next((n for n, c in enumerate(coordinates) if c.strip()), 0)  # labels of training data
    names, values = [], []
    for line, row in enumerate(rows.cells[count:], start=count + 1):
        if not "".join(row).strip():
            continue
        if len(row) != len(parts) + 1:
            raise DataError(f"{path}:{line}: has {len(row)} cells, expected {len(parts) + 1}")
        bad = next((c for c in row[1 + lead :] if c.strip() and not rows.is_number(c)), None)
        if bad is not None:
            raise DataError(f"{path}:{line}: {bad.strip()[:40]!r} is not a finite number")
        names.append("/".join(cell for cell in row[: 1 + lead] if cell.strip()))
        values.append([rows.number(cell) for cell in row[1 + lead :]])
    if not len(who) == len(parts) == len(coordinates):
        raise DataError(f"{path}: its header lines have different numbers of cells")
    columns = list(zip(who[lead:], parts[lead:], coordinates[lead:], strict=True))
    return _content(path, names, np.array(values).reshape(len(names), len(columns)), columns)


def is_deeplabcut_h5(file: Any) -> bool:
    return _table(file) is not None


def read_deeplabcut_h5(path: Path, file: Any) -> Content:
    """The table that pandas wrote.

    The names of its columns are stored as a pickle; it is not run, only its strings are listed.
    """
    table = _table(file)
    kinds = table.attrs.get("values_block_0_kind")
    if kinds is None or table.dtype.names is None or "values_block_0" not in table.dtype.names:
        raise DataError(f"{path}: not the table of one block that DeepLabCut writes; use its CSV")
    strings = _strings_of_pickle(path, bytes(kinds))
    data = read_dataset(path, table)
    values = np.asarray(data["values_block_0"], np.float64)
    width = len(strings) // max(values.shape[1], 1)
    if width not in (3, 4) or len(strings) != width * values.shape[1]:
        raise DataError(
            f"{path}: {len(strings)} names for {values.shape[1]} columns; use DeepLabCut's CSV"
        )
    columns = [
        (strings[n + 1] if width == 4 else "", strings[n + width - 2], strings[n + width - 1])
        for n in range(0, len(strings), width)
    ]
    index = data["index"]
    names = [n.decode(errors="replace") if isinstance(n, bytes) else str(n) for n in index.tolist()]
    return _content(path, names, values, columns)


def _table(file: Any) -> Any:
    """The data set called "table" in the only group that has one."""
    groups = [group for group in file.values() if hasattr(group, "keys") and "table" in group]
    return groups[0]["table"] if groups else None


def _strings_of_pickle(path: Path, data: bytes) -> list[str]:
    """All strings a pickle pushes, in order; nothing of it is run.

    What was once stored (MEMOIZE, PUT) comes back by its number (GET), as repeated names do.
    """
    strings: list[str] = []
    memory: dict[int, str | None] = {}
    last: str | None = None
    try:
        for op, argument, _ in pickletools.genops(data):
            if op.name in ("MEMOIZE", "PUT", "BINPUT", "LONG_BINPUT"):
                place = len(memory) if op.name == "MEMOIZE" else int(argument or 0)
                memory[place] = last
                continue
            last = None
            if op.name in ("GET", "BINGET", "LONG_BINGET"):
                last = memory.get(int(argument or 0))
            elif isinstance(argument, str) and "UNICODE" in op.name:
                last = argument
            if last is not None:
                strings.append(last)
    except (ValueError, TypeError, IndexError) as error:
        raise DataError(f"{path}: the names of its columns cannot be read: {error}") from error
    return strings


def _content(
    path: Path,
    names: Sequence[str],
    values: Float64Array,
    columns: Sequence[tuple[str, str, str]],
) -> Content:
    """columns: individual, body part and coordinate of each column of values (T, C)."""
    people: dict[str, dict[str, dict[str, int]]] = {}
    for c, (who, part, coordinate) in enumerate(columns):
        axes = people.setdefault(who.strip(), {}).setdefault(part.strip(), {})
        axes[coordinate.strip().lower()] = c
    parts = list(dict.fromkeys(part for of_one in people.values() for part in of_one))
    found = Content("DeepLabCut", [], joints=tuple(parts))
    found.one_person = len(people) == 1
    for n, name in enumerate(names):
        sightings = []
        for who, of_one in people.items():
            keypoints = _keypoints(values[n], of_one, parts)
            if np.isfinite(keypoints[:, :2]).all(axis=1).any():
                score = float(np.nan_to_num(keypoints[:, 2]).mean())
                where = f"{path}: row {n}" + (f", {who}" if who else "")
                sightings.append(Sighting(keypoints, score, where, identity=who or None))
        frame = whole_number(name if not name.endswith(".0") else name[:-2])
        found.pictures.append(Picture(sightings, name=name if frame is None else None, frame=frame))
    return found


def _keypoints(
    row: npt.NDArray[np.float64], of_one: dict[str, dict[str, int]], parts: Sequence[str]
) -> Float64Array:
    keypoints = np.full((len(parts), 3), np.nan)
    for j, part in enumerate(parts):
        axes = of_one.get(part, {})
        if {"x", "y"} <= set(axes):
            sure = row[axes["likelihood"]] if "likelihood" in axes else 1.0
            keypoints[j] = row[axes["x"]], row[axes["y"]], sure
    return keypoints
