"""Those who are followed and those who are found, and how well they agree."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from dance2pose.poses import FloatArray
from dance2pose.tracking.appearance import Histogram, likeness
from dance2pose.tracking.matching import (
    NEXT_PICTURE_SIGMA,
    BoxMotion,
    Float64Array,
    box_overlaps,
    box_sizes,
    keypoint_similarities,
)

# Share of each cue in the agreement of a track and a detection; absent cues are left out.
_MOTION, _BOX, _KEYPOINTS, _COLOURS = 1.0, 1.0, 1.0, 1.5
# No match further off than this many standard deviations of the motion, ...
_FURTHEST = 4.0
# ... nor with a body that is larger or smaller by more than this factor, ...
_LARGEST_CHANGE = 2.5
# ... nor with an agreement (0..1) below this.
LEAST_AGREEMENT = 0.25
# Box and keypoints of the last sight say less and less, with this time constant.
_STALE_S = 0.3
# After more than `TrackingSettings.patience_s` the colours must be alike by at least this (0..1).
_KNOWN_AGAIN = 0.6


@dataclass(frozen=True)
class Detections:
    """The people of one frame: xyxy (N, 4), xy (N, J, 2) with NaN, confidence (N, J)."""

    xyxy: Float64Array
    xy: Float64Array
    confidence: Float64Array
    colours: list[Histogram | None]
    alone: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.xyxy)


class Sights:
    """Where and how one person was seen, as plain numbers one after the other.

    NumPy arrays of their own for every sight would take three times the memory, which counts over
    an hour of video.
    """

    def __init__(self) -> None:
        self.rows = array("q")
        self.last_box: FloatArray = np.full(4, np.nan, np.float32)
        self._values = array("f")

    def add(self, row: int, xy: FloatArray, confidence: FloatArray, xyxy: FloatArray) -> None:
        """A sight in frame number `row` of those processed: (J, 2), (J,) and (4,)."""
        self.rows.append(row)
        self.last_box = xyxy.astype(np.float32)
        for part in (xy, confidence, xyxy):
            self._values.frombytes(part.astype(np.float32).tobytes())

    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Keypoints (N, J, 2), confidence (N, J) and boxes (N, 4) of the N sights, float32."""
        sights = len(self.rows)
        values = np.frombuffer(self._values.tobytes(), np.float32).reshape(sights, -1)
        joints = (values.shape[1] - 4) // 3
        xy, confidence, box = np.split(values, (2 * joints, 3 * joints), axis=1)
        return xy.reshape(sights, joints, 2), confidence, box


@dataclass
class Candidate:
    """Someone who is being followed."""

    shot: int
    motion: BoxMotion
    xy: Float64Array  # last pose, (J, 2)
    centre: Float64Array  # of the box in which it was seen
    colours: Histogram | None
    sights: Sights = field(default_factory=Sights)

    @property
    def rows(self) -> array[int]:
        """Numbers of the frames, of those processed, in which it was seen."""
        return self.sights.rows

    def expected_xy(self) -> Float64Array:
        """The last pose, moved to where the person is expected now."""
        moved: Float64Array = self.xy + (self.motion.state[0] - self.centre)
        return moved


def agreement(
    candidate: Candidate,
    detections: Detections,
    free: npt.NDArray[np.int64],
    body: list[int],
    *,
    since_s: float,
    lost: bool,
) -> Float64Array:
    """Weighted mean of the cues for each free detection, 0..1; 0 where it cannot be.

    body: columns of the keypoints that count. since_s: seconds since the candidate was last seen.
    lost: whether that is so long ago that only the colours can tell who it is.
    """
    xyxy, motion = detections.xyxy[free], candidate.motion
    away = motion.deviations(xyxy)
    size = np.array([motion.size])
    fresh = np.exp(-since_s / _STALE_S)
    cues = [
        (_MOTION, np.exp(-np.square(away) / 8)),
        (_BOX * fresh, box_overlaps(motion.xyxy[np.newaxis], xyxy)[0]),
        (
            _KEYPOINTS * fresh,
            keypoint_similarities(
                candidate.expected_xy()[np.newaxis, body],
                detections.xy[free][:, body],
                size,
                sigma=NEXT_PICTURE_SIGMA,
            )[0],
        ),
    ]
    colours = _colour_cue(candidate.colours, detections, free)
    cues.append((_COLOURS, colours))
    total, weights = np.zeros(len(free)), np.zeros(len(free))
    for weight, value in cues:
        known = np.isfinite(value)
        np.add(total, weight * value, out=total, where=known)
        np.add(weights, weight, out=weights, where=known)
    total /= weights
    change = np.abs(np.log(box_sizes(xyxy) / motion.size))
    possible = (away <= _FURTHEST) & (change <= np.log(_LARGEST_CHANGE))
    if lost:
        possible &= colours >= _KNOWN_AGAIN
    agreed: Float64Array = np.where(possible, total, 0)
    return agreed


def _colour_cue(
    known: Histogram | None, detections: Detections, free: npt.NDArray[np.int64]
) -> Float64Array:
    """Likeness of the colours, NaN where either is unknown."""
    seen = [detections.colours[i] for i in free]
    return np.array([np.nan if known is None or c is None else likeness(known, c) for c in seen])
