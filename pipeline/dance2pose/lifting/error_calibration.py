"""Standard deviations of poses, from what is known of their errors and what was measured of them.

A standard deviation here means: the distance of a joint from the truth, the first joints together
and nothing else aligned, is less than sigma in about 68 % of cases, and less than two sigma in
about 95 %. It is made of three parts that add as variances, each with a factor that is fitted on
takes and bodies that the network was not trained on (scripts/calibrate_lifter.py) and kept in the
network's own file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dance2pose.poses import FloatArray, IntArray

METADATA = "error_calibration"


@dataclass(frozen=True)
class ErrorParts:
    """What poses (N, J) err by, mm. pose: what the network expected of a joint and the solution
    left of it. noise: jitter of the keypoints. bias_mm: standard deviation of those errors of the
    keypoints that last from frame to frame, as the track shows them or as they are stated."""

    pose: FloatArray
    noise: FloatArray
    bias_mm: float

    def at(self, rows: slice) -> ErrorParts:
        """Those of some frames."""
        return ErrorParts(self.pose[rows], self.noise[rows], self.bias_mm)

    def on_rows(self, rows: IntArray, frames: int) -> ErrorParts:
        """The same for `frames` frames of which these are some; NaN in the others."""
        pose, noise = np.full((2, frames, self.pose.shape[1]), np.nan)
        pose[rows], noise[rows] = self.pose, self.noise
        return ErrorParts(pose, noise, self.bias_mm)


@dataclass(frozen=True)
class Calibration:
    """Factors of the parts: joints (J,) of `pose`, noise and bias of the others. Both of the
    latter are about the number of directions that an error of the picture becomes in space: the
    joint's own, the first joint's, which is the origin, and the depths that follow from them."""

    joints: tuple[float, ...] = field(default=(1.0,) * 17)
    noise: float = 1.4
    bias: float = 2.5

    def sigma(self, parts: ErrorParts) -> FloatArray:
        """(N, J) mm."""
        pose = np.array(self.joints) * parts.pose
        beside = np.hypot(self.noise * parts.noise, self.bias * parts.bias_mm)
        return np.asarray(np.hypot(pose, beside))


def written(sequence: Calibration, pictures: Calibration) -> str:
    """Both calibrations as text for the network's metadata."""
    return json.dumps({"sequence": _as_kept(sequence), "pictures": _as_kept(pictures)})


def _as_kept(calibration: Calibration) -> dict[str, object]:
    return {
        "joints": calibration.joints,
        "noise": calibration.noise,
        "lasting": calibration.bias,  # as networks that were written before this have it
    }


def read(metadata: Mapping[str, str], *, pictures: bool) -> Calibration:
    """The calibration for tracks or for single pictures; factors of one where there is none."""
    if METADATA not in metadata:
        return Calibration()
    values = json.loads(metadata[METADATA])["pictures" if pictures else "sequence"]
    return Calibration(tuple(values["joints"]), values["noise"], values["lasting"])
