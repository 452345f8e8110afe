"""How far a camera looks down, as the dancers before it tell.

A camera that looks down sees a floor that rises with distance. Bodies stand upright on average;
feet that stand, near and far, are on one plane; and so is the pelvis of a dancer who stands tall,
or runs. Each is weighed by its error, and one that the others contradict counts for little.

Camera axes: x right, y up, z towards the viewer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.lifting.world.contact import firm_feet
from dance2pose.lifting.world.uprightness import above_feet, upright_frames
from dance2pose.poses import FloatArray, Track3D

# Standard deviation, degrees, of what upright bodies tell (held-out takes: 4.3).
UPRIGHT_DEG = 4.0
# A plane through points is the worse known, the farther they are from one (root mean square, mm, at
# least the first: feet on a floor are 8 to 25 off, those of somebody who climbs 250) and the less
# they spread along the view: degrees times spread over distance; and never better than the last.
_OFF_PLANE_MM, _PLANE_DEG, _LEAST_DEG = 25.0, 48.0, 0.7
_STEEPEST_DEG = 70.0
_FEWEST = 8
_ANGLES = np.linspace(-90.0, 90.0, 3601)


@dataclass(frozen=True)
class TiltEvidence:
    """How far the camera looks down, degrees, by upright bodies and by planes; NaN where nothing
    tells it. planes: (angle, standard deviation) of each plane."""

    upright_deg: float
    planes: tuple[tuple[float, float], ...]

    @property
    def plane(self) -> tuple[float, float]:
        """All planes together, NaN and infinity where there is none."""
        weight = [1 / error**2 for _, error in self.planes]
        if not weight:
            return float("nan"), float("inf")
        mean = sum(w * angle for w, (angle, _) in zip(weight, self.planes, strict=True))
        return mean / sum(weight), 1 / math.sqrt(sum(weight))


def camera_tilt_deg(tracks: Sequence[Track3D], mm_per_unit: float) -> float:
    """How far the camera looks down, degrees; 0 where nothing tells it."""
    evidence = tilt_evidence(tracks, mm_per_unit)
    told = [*evidence.planes]
    if np.isfinite(evidence.upright_deg):
        told.append((evidence.upright_deg, UPRIGHT_DEG))
    if not told:
        return 0.0
    # The largest likelihood under errors with long tails (Cauchy's distribution).
    cost = sum(np.log1p(np.square((_ANGLES - angle) / error)) for angle, error in told)
    return float(np.clip(_ANGLES[np.argmin(cost)], -_STEEPEST_DEG, _STEEPEST_DEG))


def tilt_evidence(tracks: Sequence[Track3D], mm_per_unit: float) -> TiltEvidence:
    """What the tracks of one camera, in its axes, tell of its tilt."""
    directions, feet, pelvis = [], [], []
    for track in tracks:
        assert track.root is not None
        tree = skeletons.get(track.skeleton)
        above = above_feet(track.xyz, tree)
        tall = upright_frames(above) & np.isfinite(track.root).all(axis=1)
        up = above[tall] / np.linalg.norm(above[tall], axis=1, keepdims=True)
        directions.append(up)
        pelvis.append((track.root[tall] * mm_per_unit, np.ones(int(tall.sum()))))
        feet.append(firm_feet(track, mm_per_unit, _mean(up)))
    upright = _mean(np.concatenate(directions)) if directions else None
    angle = float("nan") if upright is None else float(np.degrees(np.arctan2(*upright[[2, 1]])))
    planes = [_plane(points) for points in (feet, pelvis)]
    return TiltEvidence(angle, tuple(plane for plane in planes if plane is not None))


def _mean(directions: FloatArray) -> FloatArray | None:
    """Their mean, without roll; None where there is none."""
    if not len(directions):
        return None
    mean = directions.mean(axis=0) * [0.0, 1.0, 1.0]
    return np.asarray(mean / max(float(np.linalg.norm(mean)), 1e-9))


def _plane(
    points: Sequence[tuple[FloatArray, FloatArray]],
) -> tuple[float, float] | None:
    """Slope of the planes through points, degrees, and its error; None where they do not tell.

    points: (N, 3) mm and weights (N,) of each dancer, who may be on planes of different heights but
    one slope.
    """
    enough = [(at, weight) for at, weight in points if weight.sum() >= _FEWEST]
    if not enough:
        return None
    centred = np.concatenate([at - np.average(at, axis=0, weights=w) for at, w in enough])
    weight = np.concatenate([w for _, w in enough])
    spread = math.sqrt(float(np.average(centred[:, 2] ** 2, weights=weight)))
    if spread < 1.0:
        return None
    slope = float(np.average(centred[:, 2] * centred[:, 1], weights=weight)) / spread**2
    off = centred[:, 1] - slope * centred[:, 2]
    off_plane = max(math.sqrt(float(np.average(off**2, weights=weight))), _OFF_PLANE_MM)
    error = math.hypot(_LEAST_DEG, _PLANE_DEG * off_plane / spread)
    return -math.degrees(math.atan(slope)), error
