"""Feet that stand: which, and how firmly.

T frames; mm. A foot is its ankle: the toe turns about it while the dancer stands on the whole foot
or on its ball alike.
"""

from __future__ import annotations

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.holes import unbroken
from dance2pose.poses import BoolArray, FloatArray, Track3D
from dance2pose.skeleton import Skeleton

# A foot stands where it moves no faster than the first, while the other foot or the body may, and
# is not this much higher than the lowest it has been nearby. One that slides, up to the second, is
# held back as well, by less and less from the third on.
_STANDING_MM_S, _SLIDING_MM_S, _FIRM_MM_S = 350.0, 500.0, 150.0
_LIFTED_MM = 70.0
_SHORTEST_S = 0.1
_UP = np.array([0.0, 1.0, 0.0])


def foot_joints(skeleton: Skeleton) -> tuple[int, int]:
    """The joint of the left and of the right foot that touches the floor: the ankle."""
    return skeleton.index("left_ankle"), skeleton.index("right_ankle")


def contacts(feet: FloatArray, time_s: FloatArray) -> BoolArray:
    """Which feet (T, 2) stand: slow, low and for at least a tenth of a second.

    feet: (T, 2, 3) in the world, y up.
    """
    return _low_and_slower_than(_STANDING_MM_S, feet, time_s, _UP)


def firmness(feet: FloatArray, time_s: FloatArray, up: FloatArray | None = None) -> FloatArray:
    """How firmly (T, 2) feet (T, 2, 3) stand, 0 to 1: the slower the firmer. up: (3,), y where not
    given."""
    if len(feet) < 3:
        return np.zeros(feet.shape[:2])
    stands = _low_and_slower_than(_SLIDING_MM_S, feet, time_s, _UP if up is None else up)
    return np.asarray(stands / np.square(1 + np.square(_speed(feet, time_s) / _FIRM_MM_S)))


def standing_feet(track: Track3D, mm_per_unit: float) -> BoolArray:
    """Which feet (T, 2), left and right, of a track with y up stand."""
    stands = np.zeros((len(track), 2), dtype=bool)
    for rows in known_runs(track):
        stands[rows] = contacts(feet_in_world(track, rows, mm_per_unit), track.time_s[rows])
    return stands


def firm_feet(
    track: Track3D, mm_per_unit: float, up: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Where feet stand (N, 3), mm, and how firmly (N,). up: (3,), y where not given."""
    places: list[FloatArray] = [np.zeros((0, 3))]
    weights: list[FloatArray] = [np.zeros(0)]
    for rows in known_runs(track):
        feet = feet_in_world(track, rows, mm_per_unit)
        firm = firmness(feet, track.time_s[rows], up)
        places.append(feet[firm > 0])
        weights.append(firm[firm > 0])
    return np.concatenate(places), np.concatenate(weights)


def feet_in_world(track: Track3D, rows: slice, mm_per_unit: float) -> FloatArray:
    """Where the feet (N, 2, 3) of the N rows are, mm."""
    assert track.root is not None
    joints = foot_joints(skeletons.get(track.skeleton))
    return track.xyz[rows, joints] * mm_per_unit + track.root[rows, None] * mm_per_unit


def known_runs(track: Track3D) -> list[slice]:
    """The frames in which the dancer's pose and place are known, without a break."""
    assert track.root is not None
    known = np.isfinite(track.root).all(axis=1) & np.isfinite(track.xyz).all(axis=(1, 2))
    return unbroken(np.asarray(known))


def _low_and_slower_than(
    fastest_mm_s: float, feet: FloatArray, time_s: FloatArray, up: FloatArray
) -> BoolArray:
    out: BoolArray = np.zeros(feet.shape[:2], dtype=bool)
    if len(feet) < 3:
        return out
    height = feet @ up
    lowest = height.min(axis=1, keepdims=True)
    out[:] = (_speed(feet, time_s) < fastest_mm_s) & (height < lowest + _LIFTED_MM)
    for foot in range(2):
        _drop_short(out[:, foot], time_s)
    return out


def _speed(feet: FloatArray, time_s: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.gradient(feet, time_s, axis=0), axis=-1))


def _drop_short(flags: BoolArray, time_s: FloatArray) -> None:
    for run in unbroken(flags):
        if time_s[run][-1] - time_s[run.start] < _SHORTEST_S:
            flags[run] = False
