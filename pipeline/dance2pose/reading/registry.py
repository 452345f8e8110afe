"""The formats of 2D keypoints that are known, one entry each, and how a file is recognised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dance2pose.errors import DataError, UsageError
from dance2pose.npz_files import read_arrays
from dance2pose.reading import (
    coco,
    csv_tables,
    deeplabcut,
    mediapipe,
    mmpose,
    openpose,
    rtmlib,
    sleap,
)
from dance2pose.reading.content import Content, Picture
from dance2pose.reading.json_files import load_json
from dance2pose.tables import read_rows

_LARGEST_FOLDER = 2 * 1024**3
_JSON, _CSV, _H5, _NPZ = (".json",), (".csv", ".tsv", ".txt"), (".h5", ".hdf5"), (".npz",)


@dataclass(frozen=True)
class Format:
    """One format. recognises: whether loaded content is of it. read: its people by picture.

    suffixes: of its files. Both functions get what the suffix loads: parsed JSON, `tables.Rows`,
    an open h5py file, or arrays by name.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[Any], bool]
    read: Callable[[Path, Any], Content]


# In the order in which they are tried.
FORMATS: tuple[Format, ...] = (
    Format("OpenPose JSON", _JSON, openpose.is_openpose, openpose.read_openpose),
    Format("COCO annotations", _JSON, coco.is_annotations, coco.read_annotations),
    Format("COCO or AlphaPose results", _JSON, coco.is_results, coco.read_results),
    Format(
        "AlphaPose by picture",
        _JSON,
        openpose.is_alphapose_by_picture,
        openpose.read_alphapose_by_picture,
    ),
    Format("rtmlib JSON", _JSON, rtmlib.is_rtmlib, rtmlib.read_rtmlib),
    Format("MMPose predictions", _JSON, mmpose.is_mmpose, mmpose.read_mmpose),
    Format("MediaPipe landmarks", _JSON, mediapipe.is_mediapipe, mediapipe.read_mediapipe),
    Format("DeepLabCut CSV", _CSV, deeplabcut.is_deeplabcut, deeplabcut.read_deeplabcut),
    Format("long CSV", _CSV, csv_tables.is_long, csv_tables.read_long),
    Format("wide CSV (SLEAP, MediaPipe)", _CSV, csv_tables.is_wide, csv_tables.read_wide),
    Format("SLEAP analysis h5", _H5, sleap.is_sleap, sleap.read_sleap),
    Format("DeepLabCut h5", _H5, deeplabcut.is_deeplabcut_h5, deeplabcut.read_deeplabcut_h5),
    Format(
        "rtmlib arrays",
        _NPZ,
        lambda arrays: {"keypoints", "scores"} <= set(arrays),
        rtmlib.read_rtmlib_arrays,
    ),
)
KNOWN = (
    "a track .npz; JSON of OpenPose (a folder), COCO, AlphaPose, MMPose, rtmlib or MediaPipe;"
    " CSV of DeepLabCut, SLEAP, MediaPipe or with columns such as nose_x and nose_y;"
    " .h5 of DeepLabCut or SLEAP"
)


def read_content(path: Path) -> Content:
    """Everything in a file, or in a folder of JSON files with one picture each.

    Raises DataError naming the file and what was expected.
    """
    try:
        return _read_folder(path) if path.is_dir() else _read_file(path)
    except RecursionError as error:
        raise DataError(f"{path}: nested too deeply for a keypoint file") from error


def _read_file(path: Path) -> Content:
    if not path.exists() and path.suffix.lower() not in _JSON:
        raise DataError(f"{path}: no such file or folder")
    suffix = path.suffix.lower()
    if suffix in _JSON:
        content = load_json(path)
        return _format(path, content, suffix).read(path, content)
    if suffix in _CSV:
        rows = read_rows(path)
        return _format(path, rows, suffix).read(path, rows)
    if suffix in _NPZ:
        arrays = read_arrays(path)
        return _format(path, arrays, suffix).read(path, arrays)
    if suffix in _H5:
        return _read_h5(path)
    if suffix in (".pkl", ".pickle"):
        raise DataError(f"{path}: pickles can run code and are never read; save JSON, CSV or .npz")
    raise DataError(f"{path}: not a form of 2D keypoints that is known; expected {KNOWN}")


def _read_h5(path: Path) -> Content:
    try:
        import h5py
    except ImportError as error:
        raise UsageError(
            f"{path}: reading .h5 needs h5py; install dance2pose[h5], or use the tool's CSV"
        ) from error
    try:
        with h5py.File(path, "r") as file:
            return _format(path, file, ".h5").read(path, file)
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as error:
        raise DataError(f"{path}: not an .h5 file that can be read: {error}") from error


def _format(path: Path, content: Any, suffix: str) -> Format:
    candidates = [known for known in FORMATS if suffix in known.suffixes]
    found = next((known for known in candidates if known.recognises(content)), None)
    if found is not None:
        return found
    if isinstance(content, list) and any(content):
        return next(known for known in candidates if known.read is coco.read_results)
    there = "it is empty" if content in ([], {}) else f"it holds {_in_words(content)}"
    names = ", ".join(known.name for known in candidates)
    raise DataError(f"{path}: not a form of 2D keypoints that is known; {there}; expected {names}")


def _in_words(content: Any) -> str:
    if hasattr(content, "keys"):
        keys = [str(key)[:40] for key in content]
        return ", ".join(keys[:12]) + (", …" if len(keys) > 12 else "")
    if hasattr(content, "cells"):
        return "the columns " + ", ".join(cell.strip()[:40] for cell in content.cells[0][:12])
    return f"a {type(content).__name__}"


def _read_folder(folder: Path) -> Content:
    """JSON files of one form; each that holds one picture is that picture, named by its file."""
    files = [file for file in sorted(folder.glob("*.json")) if not file.name.startswith(".")]
    if not files:
        raise DataError(f"{folder}: holds no .json file; expected those of OpenPose, one a picture")
    size = sum(file.stat().st_size for file in files)
    if size > _LARGEST_FOLDER:
        raise DataError(f"{folder}: {size / 1e9:.1f} GB of JSON are too much; split it")
    contents = [_read_picture(file) for file in files]
    forms = {content.form: file for file, content in zip(files, contents, strict=True)}
    forms.pop("", None)
    if len(forms) > 1:
        (one, file), (other, another) = list(forms.items())[:2]
        raise DataError(f"{folder}: {file.name} is of {one}, {another.name} of {other}")
    people = [c for c in contents if any(picture.people for picture in c.pictures)]
    whole = next((c for c in (*people, *contents) if c.form), contents[0])
    pictures, notes = [], []
    for file, content in zip(files, contents, strict=True):
        several = len(content.pictures) > 1 and len(files) > 1
        here = content.pictures
        pictures += [replace(p, video=file.stem) for p in here] if several else here
        notes += content.notes
    whole.pictures, whole.notes = pictures, _gathered(notes)
    return whole


def _read_picture(file: Path) -> Content:
    """One file of a folder; one that holds nothing is a picture without anyone."""
    content = load_json(file)
    if content in ([], {}, None):
        return Content("", [Picture([], name=file.name)])
    return _format(file, content, ".json").read(file, content)


def _gathered(notes: list[str]) -> list[str]:
    """The same remark of many files once, its leading number summed."""
    sums: dict[str, int] = {}
    for note in notes:
        count, _, rest = note.partition(" ")
        if count.isdecimal():
            sums[rest] = sums.get(rest, 0) + int(count)
        else:
            sums[note] = 0
    return [f"{count} {rest}" if count else rest for rest, count in sums.items()]
