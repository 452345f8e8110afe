"""Where a person's box is expected, between two looks of the detector."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from dance2pose.poses import Boxes, FloatArray, Image
from dance2pose.tracking.matching import box_overlaps

Float64Array = npt.NDArray[np.float64]

# Boxes of two key frames that overlap by this much (IoU) are one person's.
SAME_PERSON_OVERLAP = 0.3
# Of the others, boxes no further apart than this part of the longer side are the nearest person's,
# if they overlap by so much once they are laid over each other: a body does not get further
# between two looks, nor become another.
FURTHEST, SAME_SHAPE_OVERLAP = 0.6, 0.5
# Keypoints surer than this make the box about a pose.
SURE_KEYPOINT = 0.2


def pair(first: FloatArray, last: FloatArray) -> npt.NDArray[np.int64]:
    """Which boxes (N, 4) and (M, 4) of two frames are one person's: (P, 2) indices."""
    near = _assigned(box_overlaps(first, last), SAME_PERSON_OVERLAP)
    rows = np.setdiff1d(np.arange(len(first)), near[:, 0])
    columns = np.setdiff1d(np.arange(len(last)), near[:, 1])
    far = _assigned(_nearness(first[rows], last[columns]), 1 - FURTHEST)
    pairs = np.concatenate([near, np.stack([rows[far[:, 0]], columns[far[:, 1]]], axis=1)])
    return pairs[np.argsort(pairs[:, 0])]


def _assigned(likeness: Float64Array, least: float) -> npt.NDArray[np.int64]:
    pairs = np.stack(linear_sum_assignment(-likeness), axis=1)
    kept: npt.NDArray[np.int64] = pairs[likeness[pairs[:, 0], pairs[:, 1]] >= least]
    return kept


def _nearness(first: FloatArray, last: FloatArray) -> Float64Array:
    """(N, M) one less the distance of boxes of the same shape, by the longer side; else 0."""
    sides = [box[:, 2:] - box[:, :2] for box in (first, last)]
    centres = [(box[:, :2] + box[:, 2:]) / 2 for box in (first, last)]
    longest = np.maximum(sides[0].max(axis=1, initial=1)[:, None], sides[1].max(axis=1, initial=1))
    away = np.linalg.norm(centres[0][:, None] - centres[1], axis=2) / longest
    at_once = [np.concatenate([-side / 2, side / 2], axis=1) for side in sides]
    alike = box_overlaps(*at_once) >= SAME_SHAPE_OVERLAP
    return np.asarray(np.where(alike, 1 - away, 0), np.float64)


def interpolated(first: Boxes, last: Boxes, pairs: npt.NDArray[np.int64], share: float) -> Boxes:
    """The boxes of those seen in both key frames, `share` (0..1) of the way between them."""
    i, j = pairs.T
    xyxy = (1 - share) * first.xyxy[i] + share * last.xyxy[j]
    return Boxes(xyxy, (1 - share) * first.confidence[i] + share * last.confidence[j])


def keypoint_box(xy: FloatArray, confidence: FloatArray) -> Float64Array | None:
    """The box (4,) about the sure keypoints of one pose, None where there are fewer than three."""
    sure = xy[np.isfinite(xy).all(axis=1) & (confidence >= SURE_KEYPOINT)]
    if len(sure) < 3:
        return None
    return np.concatenate([sure.min(axis=0), sure.max(axis=0)]).astype(np.float64)


def within(box: Float64Array, image: Image) -> Float64Array:
    """Boxes (..., 4), ended where the picture does."""
    height, width = image.shape[:2]
    return np.clip(box, -0.5, np.array([width, height, width, height]) - 0.5)


@dataclass
class Followed:
    """One who is seen in one key frame only. margin: of the box about the sure keypoints, px."""

    box: Float64Array
    score: float
    margin: Float64Array = field(default_factory=lambda: np.zeros(4))
    begun: bool = False

    def take(self, xy: FloatArray, confidence: FloatArray, image: Image) -> None:
        """Expect the person in the next frame where the keypoints are now."""
        around = keypoint_box(xy, confidence)
        if around is None:
            return
        if not self.begun:
            self.margin, self.begun = self.box - around, True
        self.box = within(around + self.margin, image)
