"""People between two looks of the detector.

The detector looks at key frames, some frames apart. Between two of them a person seen in both has
a box by interpolation in time, which is nearer to what the detector would give than a box put
about the keypoints of the frame before. A person seen in one of the two only (one who comes,
leaves, or was missed) is followed by the keypoints, forward from the first or backward from the
last key frame. Where a pose looks doubtful the detector looks at that frame as well.

What is found depends on the frames of one stretch alone, so stretches can be worked on in any
order and number at once, with the same result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from dance2pose.expected_boxes import (
    SAME_PERSON_OVERLAP,
    Followed,
    interpolated,
    keypoint_box,
    pair,
    within,
)
from dance2pose.poses import Boxes, FloatArray, Frame, Image, Poses2D
from dance2pose.tracking.matching import (
    SAME_PICTURE_SIGMA,
    box_overlaps,
    box_sizes,
    keypoint_similarities,
)

Float64Array = npt.NDArray[np.float64]

# Two poses of one picture at least this similar (object keypoint similarity) are one person's.
SAME_POSE = 0.7
# A pose is doubtful below this share of the mean confidence that the same person had in the key
# frame, ...
LEAST_SHARE_OF_CONFIDENCE = 0.6
# ... below this confidence where the person was seen in one key frame only, ...
LEAST_CONFIDENCE = 0.3
# ... and where its keypoints leave its box by more than this part of the box's longer side.
OUTSIDE = 0.15


class Models(Protocol):
    """What finds people in one picture."""

    def detect(self, image: Image) -> Boxes: ...

    def estimate(self, image: Image, boxes: Boxes) -> Poses2D: ...


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames of one shot; the first and the last are key frames.

    next_begins: the last frame is the first of the next stretch, and its people are found there.
    cut: the first frame begins a new shot.
    """

    frames: tuple[Frame, ...]
    next_begins: bool = False
    cut: bool = False

    @property
    def own(self) -> tuple[Frame, ...]:
        """The frames whose people are found in this stretch."""
        return self.frames[:-1] if self.next_begins else self.frames


def find_in_stretch(
    stretch: Stretch, first: Boxes, last: Boxes, models: Models
) -> list[tuple[Boxes, Poses2D]]:
    """Boxes and poses of the stretch's own frames, in order.

    first, last: what the detector sees in the first and in the last frame.
    """
    frames = stretch.frames
    found = [(first, models.estimate(frames[0].image, first))]
    if len(stretch.own) == 1:
        return found
    pairs = pair(first.xyxy, last.xyxy)
    only_first = np.setdiff1d(np.arange(len(first)), pairs[:, 0])
    followed = _begin(first, only_first, found[0][1], frames[0].image)
    usual = _mean_confidence(found[0][1])[pairs[:, 0]] * LEAST_SHARE_OF_CONFIDENCE
    inner = frames[1:-1]
    for frame in inner:
        share = (frame.time_s - frames[0].time_s) / (frames[-1].time_s - frames[0].time_s)
        between = interpolated(first, last, pairs, share)
        found.append(_look(frame.image, between, usual, followed, models))
    only_last = np.setdiff1d(np.arange(len(last)), pairs[:, 1])
    expected = np.array([one.box for one in followed]).reshape(-1, 4)
    only_last = only_last[~_overlapped(last.xyxy[only_last], expected)]
    at_last = last
    if not stretch.next_begins:
        found.append((last, models.estimate(frames[-1].image, last)))
    elif len(only_last):
        at_last = Boxes(last.xyxy[only_last], last.confidence[only_last])
        only_last = np.arange(len(only_last))
    if len(only_last):
        poses = models.estimate(frames[-1].image, at_last) if stretch.next_begins else found[-1][1]
        newcomers = _begin(at_last, only_last, poses, frames[-1].image)
        _follow_back(inner, found, newcomers, models)
    return found


def _begin(
    boxes: Boxes, rows: npt.NDArray[np.int64], poses: Poses2D, image: Image
) -> list[Followed]:
    """Those of a key frame who are to be followed by their keypoints."""
    confidence = _mean_confidence(poses)
    begun = []
    for row in rows[confidence[rows] >= LEAST_CONFIDENCE]:
        one = Followed(boxes.xyxy[row].astype(np.float64), float(boxes.confidence[row]))
        one.take(poses.xy[row], poses.confidence[row], image)
        begun.append(one)
    return begun


def _look(
    image: Image, between: Boxes, usual: Float64Array, followed: list[Followed], models: Models
) -> tuple[Boxes, Poses2D]:
    """The people of one frame: where they are expected, or where that is doubtful, where they are.

    usual: (N,) confidence expected of the interpolated. followed: moved on, or taken out.
    """
    boxes = _with(between, followed)
    poses = models.estimate(image, boxes)
    least = np.concatenate([usual, np.full(len(followed), LEAST_CONFIDENCE)])
    if not _doubtful(boxes, poses, image, least).any():
        _move(followed, range(len(between), len(boxes)), poses, image)
        return boxes, poses
    boxes = models.detect(image)
    poses = models.estimate(image, boxes)
    seen = pair(np.array([one.box for one in followed]).reshape(-1, 4), boxes.xyxy)
    followed[:] = [followed[i] for i, _ in seen]
    _move(followed, seen[:, 1].tolist(), poses, image)
    return boxes, poses


def _follow_back(
    frames: Sequence[Frame],
    found: list[tuple[Boxes, Poses2D]],
    newcomers: list[Followed],
    models: Models,
) -> None:
    """Add those who came between the key frames, from the last frame back to where they came."""
    for i in reversed(range(len(frames))):
        if not newcomers:
            return
        image = frames[i].image
        boxes = _with(Boxes(np.empty((0, 4)), np.empty(0)), newcomers)
        poses = models.estimate(image, boxes)
        known_boxes, known_poses = found[i + 1]
        kept = ~_doubtful(boxes, poses, image, np.full(len(boxes), LEAST_CONFIDENCE))
        kept &= ~_already(boxes, poses, known_poses)
        newcomers = [one for one, keep in zip(newcomers, kept, strict=True) if keep]
        boxes = Boxes(boxes.xyxy[kept], boxes.confidence[kept])
        poses = _some(poses, kept)
        _move(newcomers, range(len(boxes)), poses, image)
        found[i + 1] = _joined(known_boxes, boxes), _joined_poses(known_poses, poses)


def _move(followed: list[Followed], rows: Sequence[int], poses: Poses2D, image: Image) -> None:
    for one, row in zip(followed, rows, strict=True):
        one.take(poses.xy[row], poses.confidence[row], image)


def _doubtful(
    boxes: Boxes, poses: Poses2D, image: Image, least: Float64Array
) -> npt.NDArray[np.bool_]:
    """(N,) whether a pose looks as if its box missed the person, or caught another's."""
    beyond = [
        _beyond(box, keypoint_box(xy, confidence), image)
        for box, xy, confidence in zip(boxes.xyxy, poses.xy, poses.confidence, strict=True)
    ]
    doubtful = (_mean_confidence(poses) < least) | (np.array(beyond) > OUTSIDE)
    if len(boxes) > 1:
        sizes = box_sizes(boxes.xyxy)
        alike = keypoint_similarities(poses.xy, poses.xy, sizes, sigma=SAME_PICTURE_SIGMA)
        doubtful |= (np.nan_to_num(alike) - np.eye(len(boxes)) >= SAME_POSE).any(axis=1)
    return np.asarray(doubtful, np.bool_)


def _beyond(box: FloatArray, around: Float64Array | None, image: Image) -> float:
    """How far keypoints reach out of a box, by its longer side; without keypoints, infinitely.

    Boxes end at the border of the picture, so what lies outside of that does not count.
    """
    if around is None:
        return np.inf
    around = within(around, image)
    x0, y0, x1, y1 = box.tolist()
    left, top, right, bottom = around.tolist()
    out = max(x0 - left, y0 - top, right - x1, bottom - y1)
    return float(out / max(x1 - x0, y1 - y0, 1.0))


def _already(boxes: Boxes, poses: Poses2D, known: Poses2D) -> npt.NDArray[np.bool_]:
    """(N,) whether the person is among the known poses of the same frame."""
    if not len(known):
        return np.zeros(len(poses), np.bool_)
    alike = keypoint_similarities(
        poses.xy, known.xy, box_sizes(boxes.xyxy), sigma=SAME_PICTURE_SIGMA
    )
    return np.asarray((np.nan_to_num(alike) >= SAME_POSE).any(axis=1), np.bool_)


def _overlapped(boxes: FloatArray, others: FloatArray) -> npt.NDArray[np.bool_]:
    overlap = box_overlaps(boxes, others)
    return np.asarray((overlap >= SAME_PERSON_OVERLAP).any(axis=1), np.bool_)


def _mean_confidence(poses: Poses2D) -> Float64Array:
    return np.asarray(poses.confidence.astype(np.float64).mean(axis=1))


def _some(poses: Poses2D, rows: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Poses2D:
    return Poses2D(poses.xy[rows], poses.confidence[rows], poses.skeleton)


def _with(boxes: Boxes, followed: Sequence[Followed]) -> Boxes:
    if not followed:
        return boxes
    more = Boxes(np.array([f.box for f in followed]), np.array([f.score for f in followed]))
    return _joined(boxes, more)


def _joined(one: Boxes, other: Boxes) -> Boxes:
    return Boxes(
        np.concatenate([one.xyxy, other.xyxy]), np.concatenate([one.confidence, other.confidence])
    )


def _joined_poses(one: Poses2D, other: Poses2D) -> Poses2D:
    return Poses2D(
        np.concatenate([one.xy, other.xy]),
        np.concatenate([one.confidence, other.confidence]),
        one.skeleton,
    )
