"""The curves that a recording plots of each dancer: joint angles, and how far to trust a frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dance2pose.angles import track_angles
from dance2pose.portions import dancer_rows, portions
from dance2pose.poses import BoolArray, Dancer, FloatArray
from dance2pose.skeleton import body_keypoints


class Curve(NamedTuple):
    """A title for a reader, unit included, and values (T,), NaN where the frame has none."""

    title: str
    values: FloatArray


def angle_curves(dancer: Dancer) -> dict[str, Curve]:
    """The joint angles of the smoothed poses, degrees, by name (see `angles`)."""
    angles = track_angles(dancer.smoothed, uncertain=False)
    return {name: Curve(name.replace("_", " "), curve.degrees) for name, curve in angles.items()}


def trust_curves(dancer: Dancer) -> dict[str, Curve]:
    """What tells how far to trust each frame: means over what was seen, a count of what was lifted.

    By entity name: confidence (of the body, without hands and face), reprojection_error (px),
    invalid_bones, and sigma where the lifter knows its uncertainty (in hundredths of the unit of
    the poses: cm, or % of the body height).
    """
    rows = list(portions(len(dancer.keypoints))) or [slice(0)]
    parts = [_trust_curves(dancer_rows(dancer, some)) for some in rows]
    return {
        name: Curve(curve.title, np.concatenate([part[name].values for part in parts]))
        for name, curve in parts[0].items()
    }


def _trust_curves(dancer: Dancer) -> dict[str, Curve]:
    track, joints = dancer.keypoints, dancer.smoothed
    # Smoothing drops what it cannot know again: error and sigma are those of the lifted poses.
    raw = dancer.raw
    body = body_keypoints(track.skeleton)
    seen = np.asarray(~np.isnan(track.xy[:, body]).any(axis=2))
    lifted = ~np.isnan(joints.xyz).all(axis=(1, 2))
    invalid = np.where(lifted, (~joints.valid).sum(axis=1), np.nan)
    error = raw.reprojection_error
    curves = {
        "confidence": Curve("mean confidence", _row_mean(track.confidence[:, body], seen)),
        "reprojection_error": Curve("reprojection, px", _row_mean(error, ~np.isnan(error))),
        "invalid_bones": Curve("invalid bones", invalid),
    }
    if raw.sigma is not None:
        mean = _row_mean(raw.sigma, ~np.isnan(raw.sigma))
        unit = "cm" if joints.unit == "metres" else "% of body height"
        curves["sigma"] = Curve(f"mean sigma, {unit}", 100 * mean)
    return curves


def _row_mean(values: FloatArray, known: BoolArray) -> FloatArray:
    """Mean (T,) over the known values (T, J) of each row, NaN where a row has none."""
    count = known.sum(axis=1)
    total = np.where(known, values, 0).sum(axis=1, dtype=np.float64)
    mean: FloatArray = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return mean
