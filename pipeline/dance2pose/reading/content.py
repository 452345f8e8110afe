"""What a format's reader gives back: pictures with the people in them, as the file says it.

Nothing is judged here: which numbers are measurements is for `measurements`, which frame a picture
is for `numbering`, which skeleton it is for `layouts`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sighting:
    """One person of one picture.

    keypoints: (J, 3) x, y and confidence. score: of the whole person. where: in the file.
    box: (4,) xyxy, or None. identity: who it is, where the file says so.
    """

    keypoints: Float64Array
    score: float
    where: str
    box: Float64Array | None = None
    identity: str | None = None


@dataclass(frozen=True)
class Picture:
    """One picture and all that names it; people may be none.

    name: of its file. frame: the frame number, where the file states one. key: of the entry
    (COCO's id). time_s: where the file has times. video: where the file says which it is of.
    size: width and height, px.
    """

    people: list[Sighting]
    name: str | None = None
    frame: int | None = None
    key: int | str | None = None
    time_s: float | None = None
    video: str = ""
    size: tuple[int, int] | None = None


@dataclass
class Content:
    """All that is in a file or folder.

    form: the format in words. joints: names of the keypoints, in their order, where the file
    has them. skeleton: where the format has only one. normalised: coordinates are parts of the
    picture by the format's definition. open_scores: scores that are not probabilities, so that
    some above 1 are usual. one_person: whoever is seen is the same person. notes: what the
    reader left out, and other remarks.
    """

    form: str
    pictures: list[Picture]
    joints: tuple[str, ...] | None = None
    skeleton: str | None = None
    normalised: bool = False
    open_scores: bool = False
    one_person: bool = False
    notes: list[str] = field(default_factory=list)


def points(value: Any, where: str, scores: Any = None) -> Float64Array:
    """Keypoints in any of the usual forms as (J, 3) x, y, confidence.

    value: flat x, y, confidence of one after the other, or a list of [x, y] or [x, y,
    confidence]. scores: (J,) confidences beside [x, y]; without any, 1. `null` is NaN.
    Raises DataError.
    """
    numbers = _numbers(value, where)
    if numbers.ndim == 2 and numbers.shape[1] in (2, 3):
        found = numbers
    elif numbers.ndim == 1 and len(numbers) and len(numbers) % 3 == 0 and scores is None:
        found = numbers.reshape(-1, 3)
    elif numbers.ndim == 1 and len(numbers) and len(numbers) % 2 == 0:
        found = numbers.reshape(-1, 2)
    else:
        count = f"{numbers.size} numbers" if numbers.ndim == 1 else f"shape {numbers.shape}"
        raise DataError(f"{where} has {count}, expected x, y, confidence for each keypoint")
    if scores is None:
        return found if found.shape[1] == 3 else np.column_stack([found, np.ones(len(found))])
    sure = _numbers(scores, where.rpartition(".")[0] + ", its scores")
    if sure.shape != (len(found),):
        raise DataError(f"{where} has {len(found)} keypoints and {sure.size} scores")
    return np.column_stack([found[:, :2], sure])


def _numbers(value: Any, where: str) -> Float64Array:
    if not isinstance(value, list):
        raise DataError(f"{where} is of type {type(value).__name__}, expected a list")
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise DataError(f"{where} does not hold plain numbers: {error}") from error


def box_from(value: Any, *, corner_and_size: bool) -> Float64Array | None:
    """A box as xyxy, None where there is none: x, y, width, height or the two corners."""
    if isinstance(value, list) and len(value) == 1:
        value = value[0]  # MMPose nests it once more
    try:
        box = np.array(value, dtype=np.float64).ravel()[:4]
    except (ValueError, TypeError, OverflowError):
        return None
    if box.shape != (4,) or not np.isfinite(box).all():
        return None
    if corner_and_size:
        box[2:] += box[:2]
    return box
