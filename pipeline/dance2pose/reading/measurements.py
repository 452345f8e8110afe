"""What is a measurement: every reader's keypoints go through here.

Tools write a keypoint that they did not find as (0, 0), a picture without anyone as a person whose
points all lie in one place, coordinates as parts of the picture, scores as flags or percent. Here
these become missing, are rescaled, or are refused; what was done is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError, UsageError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting

Size = tuple[int, int]

# Coordinates within this are parts of a picture: no picture is two px wide. (A few px more are
# left to points that a model puts outside.)
_PARTS, _MOST = 1.5, 95
# This share of negative coordinates makes parts run from -1 to 1 (OpenPose's keypoint scale 4).
_NEGATIVE = 0.02
# Scores up to this are ones that overshoot or are logits (AlphaPose's COCO models: up to 6) and
# count as sure; up to 100 they are percent.
_OVERSHOOT, _PERCENT = 10.0, 100.0
# More points than this share outside the picture: the picture has another size.
_MOST_OUTSIDE = 0.5


def measured(
    content: Content, where: str, image_size: Size | None
) -> tuple[list[Picture], list[str]]:
    """The pictures with only what was measured in them, in px, and what is to be said about it.

    image_size: of all pictures, (0, 0) or None where each has its own or none. Keypoints that
    were not seen are NaN with confidence 0; who has none left is not there. Raises DataError or,
    where only the size of the picture is lacking, UsageError.
    """
    rows = [(n, person) for n, picture in enumerate(content.pictures) for person in picture.people]
    if not rows:
        return list(content.pictures), []
    sizes = [image_size or content.pictures[n].size or (0, 0) for n, _ in rows]
    people = [person for _, person in rows]
    all_points = np.concatenate([person.keypoints for person in people])
    of_person = np.repeat(np.arange(len(people)), [len(person.keypoints) for person in people])
    notes: list[str] = []
    missing = _missing(all_points, where, notes)
    all_points[:, 2] = _scores(all_points[:, 2], missing, content, where, notes)
    all_points[missing] = (np.nan, np.nan, 0.0)
    all_points[:, :2] = _in_px(
        all_points[:, :2], np.array(sizes)[of_person], content.normalised, where, notes
    )
    parts = np.split(all_points, np.flatnonzero(np.diff(of_person)) + 1)
    kept = _real(people, parts, sizes, where, notes)
    pictures = [replace(picture, people=[]) for picture in content.pictures]
    for (n, person), keypoints, keep in zip(rows, parts, kept, strict=True):
        if keep:
            pictures[n].people.append(replace(person, keypoints=keypoints))
    return pictures, notes


def _missing(points: Float64Array, where: str, notes: list[str]) -> npt.NDArray[np.bool_]:
    broken = ~np.isfinite(points).all(axis=1)
    unseen = broken | (points[:, 2] <= 0)
    if unseen.all() and not broken.all() and (points[~broken, :2] != 0).any():
        raise DataError(f"{where}: no keypoint has a confidence above 0, so that none was seen")
    zero = ~unseen & (points[:, :2] == 0).all(axis=1)
    if zero.any():
        notes.append(f"{zero.sum()} keypoints at exactly (0, 0) are missing ones")
    return np.asarray(unseen | zero)


def _scores(
    scores: Float64Array,
    missing: npt.NDArray[np.bool_],
    content: Content,
    where: str,
    notes: list[str],
) -> Float64Array:
    """Confidences in 0..1, of any scale that tools use."""
    seen = scores[~missing]
    highest = float(seen.max(initial=0.0))
    if highest <= 1:
        return scores
    if np.isin(seen, (1, 2)).all():
        notes.append("scores of 1 and 2 are visibility flags: the keypoint is there")
        return np.minimum(scores, 1.0)
    if highest <= _OVERSHOOT or content.open_scores:
        if not content.open_scores:
            notes.append(f"{(seen > 1).sum()} scores above 1 (up to {highest:.3g}) count as 1")
        return np.minimum(scores, 1.0)
    if highest <= _PERCENT:
        notes.append(f"scores up to {highest:.3g} are percent")
        return scores / 100
    raise DataError(
        f"{where}: scores run up to {highest:.3g}; expected confidences from 0 to 1 (or percent)"
    )


def _in_px(
    xy: Float64Array,
    sizes: npt.NDArray[np.int64],
    normalised: bool,
    where: str,
    notes: list[str],
) -> Float64Array:
    """Coordinates that are parts of the picture, 0..1 or -1..1, in px."""
    seen = xy[np.isfinite(xy[:, 0])]
    if not normalised:
        if not len(seen) or np.percentile(np.abs(seen), _MOST) > _PARTS:
            return xy
        if np.ptp(seen, axis=0).max() == 0:
            return xy  # one point: for `_real`
    if (sizes <= 0).any():
        raise UsageError(
            f"{where}: its coordinates are parts of the picture, not px; give the size of the"
            " picture (--image-size WIDTH HEIGHT)"
        )
    both_ways = not normalised and (seen < 0).mean() > _NEGATIVE
    notes.append(
        f"coordinates are parts of the picture ({'-1 to 1' if both_ways else '0 to 1'}),"
        " brought to px by its size"
    )
    parts = (xy + 1) / 2 if both_ways else xy
    return parts * sizes - 0.5  # the centre of the first pixel is at 0


def _real(
    people: Sequence[Sighting],
    parts: Sequence[Float64Array],
    sizes: Sequence[Size],
    where: str,
    notes: list[str],
) -> npt.NDArray[np.bool_]:
    """Who was seen at all: not a single point, not from a box without size, in the picture."""
    seen = np.array([np.isfinite(part[:, 0]).any() for part in parts])
    one_point = seen & np.array([_extent(part) == 0 for part in parts])
    flat = np.array([p.box is not None and not (p.box[2:] > p.box[:2]).all() for p in people])
    boxes = sum(person.box is not None for person in people)
    if flat.any() and flat.sum() == boxes:
        notes.append("boxes without size are no boxes")  # a converter's filler
        flat[:] = False
    outside = _outside(parts, sizes, where) & seen & ~one_point
    for who, what in (
        (~seen, "without any keypoint"),
        (one_point, "whose keypoints are all one point"),
        (flat & seen & ~one_point, "found in a box without size"),
        (outside & ~flat, "whose keypoints are all outside the picture"),
    ):
        if who.any():
            notes.append(f"{who.sum()} people {what} are not there")
    return np.asarray(seen & ~one_point & ~flat & ~outside)


def _extent(part: Float64Array) -> float:
    """The larger side of the box around the points; a single point alone is no evidence."""
    xy = part[np.isfinite(part[:, 0]), :2]
    return float(np.ptp(xy, axis=0).max()) if len(xy) > 1 else np.inf


def _outside(
    parts: Sequence[Float64Array], sizes: Sequence[Size], where: str
) -> npt.NDArray[np.bool_]:
    out = np.zeros(len(parts), np.bool_)
    points = points_outside = 0
    for n, (part, size) in enumerate(zip(parts, sizes, strict=True)):
        xy = part[np.isfinite(part[:, 0]), :2]
        if min(size) <= 0 or not len(xy):
            continue
        away = ((xy < -0.5) | (xy > np.array(size) - 0.5)).any(axis=1)
        points, points_outside = points + len(xy), points_outside + int(away.sum())
        out[n] = away.all()
    if points and points_outside > _MOST_OUTSIDE * points:
        width, height = sizes[0]
        raise DataError(
            f"{where}: {points_outside / points:.0%} of the keypoints are outside a picture of"
            f" {width} x {height}; is that the size of the picture they were found in?"
        )
    return out
