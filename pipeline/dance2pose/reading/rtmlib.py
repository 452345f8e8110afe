"""What rtmlib returns, as people save it: `keypoints` and `scores` of every picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting
from dance2pose.reading.json_files import FRAME_KEYS, first, number, require, size_of, whole_number


def is_rtmlib(content: Any) -> bool:
    """A dictionary of both, or a list of one a picture."""
    if isinstance(content, list):
        content = next((one for one in content if one), None)
    return isinstance(content, dict) and "keypoints" in content and "scores" in content


def read_rtmlib(path: Path, content: Any) -> Content:
    """keypoints [N][J][2] px and scores [N][J] a picture, or all pictures in one list."""
    found = Content("rtmlib", [], open_scores=True)
    if isinstance(content, dict):
        where = f"{path}: keypoints"
        pairs = zip(content["keypoints"], content["scores"], strict=False)
        lengths = [
            len(v) if isinstance(v, list) else -1 for v in (content["keypoints"], content["scores"])
        ]
        if lengths[0] != lengths[1] or lengths[0] < 0:
            raise DataError(f"{where} and scores are not lists of one length")
        if _depth(content["keypoints"]) < 4:  # of one picture
            pairs = zip([content["keypoints"]], [content["scores"]], strict=True)
        for n, (keypoints, scores) in enumerate(pairs):
            people = _people(keypoints, scores, f"{where}[{n}]")
            found.pictures.append(Picture(people))
        if len(found.pictures) == 1:
            found.pictures = [Picture(found.pictures[0].people, name=path.name)]
        return found
    for n, one in enumerate(content):
        if one is None or one == {}:
            found.pictures.append(Picture([]))
            continue
        require(path, one, ("keypoints", "scores"), f"[{n}]")
        name = first(one, "image", "file_name", "img_path", "image_path")
        found.pictures.append(
            Picture(
                _people(one["keypoints"], one["scores"], f"{path}: [{n}].keypoints"),
                name=name if isinstance(name, str) else None,
                frame=whole_number(first(one, *FRAME_KEYS)),
                time_s=number(first(one, "time_s", "timestamp_s")),
                size=size_of(one),
            )
        )
    return found


def read_rtmlib_arrays(path: Path, arrays: dict[str, npt.NDArray[Any]]) -> Content:
    """keypoints (T, N, J, 2) or (T, J, 2) px and scores without the last axis; NaN is missing."""
    keypoints, scores = arrays["keypoints"], arrays["scores"]
    if keypoints.dtype.kind not in "fiu" or scores.dtype.kind not in "fiu":
        raise DataError(
            f"{path}: keypoints and scores have types {keypoints.dtype}, {scores.dtype}"
        )
    if keypoints.ndim == 3:
        keypoints, scores = keypoints[:, np.newaxis], scores[:, np.newaxis]
    if keypoints.ndim != 4 or keypoints.shape[-1] != 2 or scores.shape != keypoints.shape[:-1]:
        raise DataError(
            f"{path}: keypoints and scores have shapes {arrays['keypoints'].shape} and"
            f" {arrays['scores'].shape}, expected (T, N, J, 2) and (T, N, J)"
        )
    found = Content("rtmlib", [], open_scores=True)
    for n in range(len(keypoints)):
        where = f"{path}: keypoints[{n}]"
        found.pictures.append(Picture(_sightings(keypoints[n], scores[n], where)))
    return found


def _depth(value: Any) -> int:
    depth = 0
    while isinstance(value, list):
        depth += 1
        value = next((one for one in value if one), None)
    return depth


def _people(keypoints: Any, scores: Any, where: str) -> list[Sighting]:
    if keypoints in (None, []):
        return []
    try:
        xy, sure = np.array(keypoints, np.float64), np.array(scores, np.float64)
    except (ValueError, TypeError, OverflowError) as error:
        raise DataError(f"{where} and its scores do not hold plain numbers: {error}") from error
    if xy.ndim == 2:
        xy, sure = xy[np.newaxis], sure.reshape(1, -1)
    if xy.ndim != 3 or xy.shape[-1] != 2 or sure.shape != xy.shape[:-1]:
        raise DataError(
            f"{where} and its scores have shapes {xy.shape} and {sure.shape},"
            " expected (N, J, 2) and (N, J)"
        )
    return _sightings(xy, sure, where)


def _sightings(xy: npt.NDArray[Any], scores: npt.NDArray[Any], where: str) -> list[Sighting]:
    together: Float64Array = np.concatenate(
        [xy, scores[..., np.newaxis]], axis=-1, dtype=np.float64
    )
    return [
        Sighting(keypoints, float(np.nan_to_num(keypoints[:, 2]).mean()), f"{where}[{n}]")
        for n, keypoints in enumerate(together)
        if not np.isnan(keypoints[:, :2]).all()
    ]
