"""Which way is up, as bodies show it: their centre of mass is above their feet, on average.

T frames, J joints of a lifting skeleton.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# Masses as parts of the body's, each taken to be in the middle between two joints (Dempster, in
# Winter, Biomechanics and Motor Control of Human Movement); hands are with the forearms.
_TRUNK, _HEAD = 0.497, 0.081
_OF_SIDE = (
    (("hip", "knee"), 0.1),
    (("knee", "ankle"), 0.061),
    (("shoulder", "elbow"), 0.028),
    (("elbow", "wrist"), 0.022),
)


def centre_of_mass(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Centres of mass (T, 3) of poses (T, J, 3)."""
    head = skeleton.index("head")
    neck = skeleton.parents[head]
    parts = [(0, neck, _TRUNK), (neck, head, _HEAD)]
    for side in ("left", "right"):
        for ends, mass in _OF_SIDE:
            a, b = (skeleton.index(f"{side}_{end}") for end in ends)
            parts.append((a, b, mass))
    total = sum(mass for _, _, mass in parts)
    moments = sum(mass * (xyz[:, a] + xyz[:, b]) / 2 for a, b, mass in parts)
    return np.asarray(moments / total)


def above_feet(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """From the middle of the feet to the centre of mass (T, 3)."""
    names = [f"{side}_{part}" for side in ("left", "right") for part in ("ankle", "toe")]
    feet = [skeleton.index(name) for name in names if name in skeleton.joints]
    return np.asarray(centre_of_mass(xyz, skeleton) - xyz[:, feet].mean(axis=1))


def upright_frames(above: FloatArray) -> BoolArray:
    """Which frames (T,) bool are of the half in which the body stands tallest.

    above: (T, 3) from `above_feet`, NaN where nothing is known.
    """
    tall = np.linalg.norm(above, axis=1)
    known: BoolArray = np.isfinite(tall) & (tall > 0)
    if not known.any():
        return known
    with np.errstate(invalid="ignore"):
        return np.asarray(known & (tall >= np.median(tall[known])))
