"""2D keypoints as CSV: wide tables (a row a frame or a frame and person) and long ones (a row a
keypoint), as SLEAP, users of MediaPipe and many scripts write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting
from dance2pose.reading.json_files import whole_number
from dance2pose.tables import FRAME_NAMES, TIME_NAMES, Rows

_SURE = "visibility|vis|v|confidence|conf|score|likelihood|presence|prob|p|c"
_LAST = re.compile(rf"(?P<joint>.*?)[\s_.:|-]*(?P<axis>x|y|z|{_SURE})", re.IGNORECASE)
_FIRST = re.compile(rf"(?P<axis>x|y|z|{_SURE})[\s_.:|-]*(?P<joint>\d+|.+)", re.IGNORECASE)
_PERSON = {"person", "person_id", "track", "track_id", "individual", "individuals", "dancer"}
_JOINT = {
    *("joint", "joint_name", "keypoint", "keypoint_name", "bodypart", "landmark", "landmark_name"),
    *("landmark_id", "landmark_index", "landmark_idx", "name", "marker", "keypoint_id"),
}
_MILLISECONDS = {"timestamp_ms", "time_ms", "timestampms"}
_NAME = {"image", "image_name", "file_name", "filename", "image_path", "img"}


class _Columns:
    """Where the columns that are not coordinates stand; None where there is none."""

    def __init__(self, names: Sequence[str]) -> None:
        self.lower = [name.strip().lower() for name in names]
        self.frame = self._find(FRAME_NAMES | {"frame_no", "framenumber"})
        if self.frame is None and self.lower[:1] in (["index"], [""]):
            self.frame = 0
        self.time = self._find(TIME_NAMES)
        self.milliseconds = self._find(_MILLISECONDS)
        self.person = self._find(_PERSON)
        self.joint = self._find(_JOINT)
        self.name = self._find(_NAME)

    def _find(self, names: set[str]) -> int | None:
        return next((c for c, name in enumerate(self.lower) if name in names), None)

    def known(self) -> set[int | None]:
        return {self.frame, self.time, self.milliseconds, self.person, self.joint, self.name}


def is_long(rows: Rows) -> bool:
    """A row a keypoint: a column that names it, and x and y."""
    columns = _Columns(rows.cells[0])
    return columns.joint is not None and {"x", "y"} <= set(columns.lower)


def read_long(path: Path, rows: Rows) -> Content:
    """Rows grouped by frame and person; what is not listed is missing."""
    columns = _Columns(rows.cells[0])
    assert columns.joint is not None
    x, y = columns.lower.index("x"), columns.lower.index("y")
    sure = next((c for c, n in enumerate(columns.lower) if re.fullmatch(_SURE, n)), None)
    joints: dict[str, int] = {}
    found: dict[tuple[str, str], tuple[list[str], dict[int, tuple[float, ...]]]] = {}
    for n, row in enumerate(rows.cells[1:], start=2):
        if not "".join(row).strip():
            continue
        _check_width(path, row, len(columns.lower), n)
        joint = joints.setdefault(row[columns.joint].strip(), len(joints))
        moment = _cell(row, columns.frame) or _cell(row, columns.time) or _cell(row, columns.name)
        person = _cell(row, columns.person)
        _, points = found.setdefault((moment, person), (row, {}))
        if joint in points:
            raise DataError(
                f"{path}:{n}: a second row of keypoint {row[columns.joint]!r} in frame"
                f" {moment or '(no frame column)'}; a column such as person tells people apart"
            )
        points[joint] = (
            _number(rows, path, n, row, x),
            _number(rows, path, n, row, y),
            1.0 if sure is None else _number(rows, path, n, row, sure),
        )
    entries = []
    for (_, person), (row, points) in found.items():
        keypoints = np.full((len(joints), 3), np.nan)
        for joint, values in points.items():
            keypoints[joint] = values
        entries.append((row, person, keypoints))
    return _content(path, rows, columns, entries, tuple(joints))


def is_wide(rows: Rows) -> bool:
    """A row a frame: columns that end (or begin) with x and y."""
    return len(_wide_joints(rows.cells[0])) >= 4


def read_wide(path: Path, rows: Rows) -> Content:
    """Columns grouped by the joint that their names hold."""
    columns = _Columns(rows.cells[0])
    axes_of = _wide_joints(rows.cells[0])
    _refuse_space(path, axes_of)
    entries = []
    for n, row in enumerate(rows.cells[1:], start=2):
        if not "".join(row).strip():
            continue
        _check_width(path, row, len(columns.lower), n)
        keypoints = np.full((len(axes_of), 3), np.nan)
        for j, axes in enumerate(axes_of.values()):
            keypoints[j, 0] = _number(rows, path, n, row, axes["x"])
            keypoints[j, 1] = _number(rows, path, n, row, axes["y"])
            sure = axes.get("sure")
            keypoints[j, 2] = 1.0 if sure is None else _number(rows, path, n, row, sure)
        entries.append((row, _cell(row, columns.person), keypoints))
    return _content(path, rows, columns, entries, tuple(axes_of))


def _wide_joints(header: Sequence[str]) -> dict[str, dict[str, int]]:
    """Joint to the columns of its axes; only joints with x and y."""
    known = _Columns(header).known()
    for pattern in (_LAST, _FIRST):
        found: dict[str, dict[str, int]] = {}
        for c, name in enumerate(header):
            match = pattern.fullmatch(name.strip())
            if match is None or c in known or not match["joint"]:
                continue
            axis = match["axis"].lower()
            key = axis if axis in "xyz" else "sure"
            found.setdefault(match["joint"].strip(), {}).setdefault(key, c)
        whole = {joint: axes for joint, axes in found.items() if {"x", "y"} <= set(axes)}
        if whole:
            return whole
    return {}


def _refuse_space(path: Path, axes_of: dict[str, dict[str, int]]) -> None:
    """Three coordinates and no confidence are positions in space; MediaPipe's 33 have a depth."""
    if len(axes_of) != 33 and all("z" in axes and "sure" not in axes for axes in axes_of.values()):
        raise DataError(f"{path}: holds 3D positions (x, y, z), expected 2D keypoints")


def _content(
    path: Path,
    rows: Rows,
    columns: _Columns,
    entries: list[tuple[list[str], str, Float64Array]],
    joints: tuple[str, ...],
) -> Content:
    """One picture a frame, in the order of the file; people by their column."""
    pictures: dict[str, Picture] = {}
    for n, (row, person, keypoints) in enumerate(entries):
        moment = _cell(row, columns.frame) or _cell(row, columns.time) or _cell(row, columns.name)
        picture = pictures.setdefault(moment or f"row {n}", _picture(rows, columns, row))
        if np.isnan(keypoints[:, :2]).all():
            continue
        where = f"{path}: frame {moment}" if moment else f"{path}: row {n + 1} of the data"
        if columns.person is None and picture.people:
            raise DataError(
                f"{where} has several rows, and no column (such as person) tells them apart"
            )
        sure = keypoints[:, 2]
        score = float(np.nan_to_num(sure).mean())
        picture.people.append(Sighting(keypoints, score, where, identity=person or None))
    found = Content("CSV table", list(pictures.values()))
    found.one_person = columns.person is None
    numbers = [re.fullmatch(r"(?:landmark|keypoint|point|joint|kp)?[\s_]*(\d+)", j) for j in joints]
    if all(numbers):
        _by_number(found, [int(m[1]) for m in numbers if m])
    else:
        found.joints = joints
    return found


def _by_number(found: Content, numbers: list[int]) -> None:
    """Joints that are only numbered, in the order of their numbers, from 0 or from 1."""
    order = np.argsort(numbers)
    for picture in found.pictures:
        picture.people[:] = [
            Sighting(p.keypoints[order], p.score, p.where, p.box, p.identity)
            for p in picture.people
        ]


def _picture(rows: Rows, columns: _Columns, row: list[str]) -> Picture:
    time_s = _value(rows, row, columns.time)
    milliseconds = _value(rows, row, columns.milliseconds)
    if time_s is None and milliseconds is not None:
        time_s = milliseconds / 1000
    frame = _value(rows, row, columns.frame)
    return Picture(
        [],
        name=_cell(row, columns.name) or None,
        frame=None if frame is None else whole_number(frame),
        time_s=time_s,
    )


def _value(rows: Rows, row: list[str], column: int | None) -> float | None:
    if column is None or not rows.is_number(row[column]):
        return None
    return rows.number(row[column])


def _cell(row: list[str], column: int | None) -> str:
    return "" if column is None else row[column].strip()


def _number(rows: Rows, path: Path, line: int, row: list[str], column: int) -> float:
    if row[column].strip() and not rows.is_number(row[column]):
        raise DataError(
            f"{path}:{line}: {row[column].strip()[:40]!r} is not a finite number;"
            " leave missing cells empty"
        )
    return rows.number(row[column])


def _check_width(path: Path, row: list[str], width: int, line: int) -> None:
    if len(row) != width:
        raise DataError(f"{path}:{line}: has {len(row)} cells, expected {width}")
