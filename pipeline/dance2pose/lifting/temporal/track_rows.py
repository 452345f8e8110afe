"""The rows of a track in which there is a dancer to lift, and what was seen there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import Body, body_bones_mm
from dance2pose.lifting.lifted import Observed
from dance2pose.lifting.pursuit.paper import FEWEST_JOINTS
from dance2pose.poses import FloatArray, IntArray
from dance2pose.skeleton import Skeleton

# A dancer who is out of sight for longer than this is not guessed at.
LONGEST_GAP_S = 0.5
# Keypoint models err alike for as long as a pose and a costume look alike, mm in either direction
# of the picture: no jitter tells, no average mends. (People who mark joints scatter by 20 to 60
# mm.) The joints of the other skeletons come from motion capture.
_KEYPOINT_BIAS_MM = {"body17": 20.0}


@dataclass(frozen=True)
class Rows:
    """N frames of one dancer, all stretches of a track one after the other.

    xy: (N, J, 2) px, y up, NaN where not seen. confidence: (N, J). time_s: (N,). parts: the rows of
    each stretch. body: bone lengths known before, or None.
    """

    xy: FloatArray
    confidence: FloatArray
    time_s: FloatArray
    parts: tuple[IntArray, ...]
    skeleton: str
    body: Body | None = None

    @property
    def tree(self) -> Skeleton:
        return skeletons.get(self.skeleton)

    @property
    def usual_mm(self) -> FloatArray:
        """Bone lengths (J - 1,) of the one body."""
        return body_bones_mm(self.skeleton)

    @property
    def body17(self) -> bool:
        return self.skeleton == "body17"

    @property
    def bias_mm(self) -> float:
        """Lasting errors of keypoints, in either direction of the picture, as assumed."""
        return _KEYPOINT_BIAS_MM.get(self.skeleton, 0.0)

    def scaled(self, factor: FloatArray) -> Rows:
        """The same with image points multiplied by factors that broadcast against (N, J, 2)."""
        return replace(self, xy=self.xy * factor)


def rows_of(observed: Observed) -> tuple[IntArray, Rows]:
    """The rows of a track that can be lifted (N,), and what was seen in them."""
    found = stretches(observed)
    rows = np.concatenate(found) if found else np.zeros(0, int)
    ends = np.cumsum([len(part) for part in found])
    parts = np.split(np.arange(len(rows)), ends[:-1]) if found else []
    return rows, Rows(
        observed.xy[rows],
        observed.confidence[rows],
        np.asarray(observed.time_s[rows]),
        tuple(parts),
        observed.skeleton,
        observed.body,
    )


def stretches(observed: Observed) -> list[IntArray]:
    """Rows between the first and last sight of the dancer, cut where the dancer is long away."""
    enough = np.isfinite(observed.xy).all(axis=-1).sum(axis=1) >= FEWEST_JOINTS
    seen = np.flatnonzero(enough)
    if not len(seen):
        return []
    if observed.independent:
        return [seen]
    cuts = np.flatnonzero(np.diff(observed.time_s[seen]) > LONGEST_GAP_S)
    starts, stops = seen[np.r_[0, cuts + 1]], seen[np.r_[cuts, len(seen) - 1]]
    return [np.arange(a, b + 1) for a, b in zip(starts, stops, strict=True)]
