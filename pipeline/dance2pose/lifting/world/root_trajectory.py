"""The dancer's path through the room: feet that stand do not slide.

T frames; axes x right, y up, z towards the viewer; mm. A foot is its ankle and, where the skeleton
has one, its toe.
"""

from __future__ import annotations

import numpy as np

from dance2pose.holes import unbroken
from dance2pose.lifting.world.path_solver import solve_path
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# A foot stands where it moves no faster than this, while the other foot or the body may, and is
# not this much higher than the lowest it has been nearby.
_STANDING_MM_S = 350.0
_LIFTED_MM = 70.0
_SHORTEST_S = 0.1


def foot_joints(skeleton: Skeleton) -> tuple[int, int]:
    """The joint of the left and of the right foot that touches the floor: the ankle.

    The toe turns about it while the dancer stands on the whole foot or on its ball alike.
    """
    return skeleton.index("left_ankle"), skeleton.index("right_ankle")


def follow_floor(
    xyz: FloatArray, root: FloatArray, time_s: FloatArray, skeleton: Skeleton
) -> FloatArray:
    """The path (T, 3) near `root` along which standing feet neither slide nor leave the floor.

    xyz: (T, J, 3) poses with the first joint at the origin. root: (T, 3) found frame by frame, NaN
    where it could not be; the camera at the origin. See `path_solver`.
    """
    seen, feet = _filled(root), xyz[:, foot_joints(skeleton)]
    path = solve_path(seen, feet, np.zeros(feet.shape[:2], dtype=bool), time_s)
    for _ in range(2):
        contact = contacts(xyz, path, time_s, skeleton)
        path = solve_path(seen, feet, contact, time_s)
    return path


def contacts(
    xyz: FloatArray, root: FloatArray, time_s: FloatArray, skeleton: Skeleton
) -> BoolArray:
    """Which feet (T, 2) stand: slow, low and for at least a tenth of a second."""
    out: BoolArray = np.zeros((len(xyz), 2), dtype=bool)
    if len(xyz) < 3:
        return out
    feet = xyz[:, foot_joints(skeleton)] + root[:, None]
    speed = np.linalg.norm(np.gradient(feet, time_s, axis=0), axis=-1)
    lowest = np.minimum(feet[:, 0, 1], feet[:, 1, 1])
    out[:] = (speed < _STANDING_MM_S) & (feet[..., 1] < lowest[:, None] + _LIFTED_MM)
    for foot in range(2):
        _drop_short(out[:, foot], time_s)
    return out


def _drop_short(flags: BoolArray, time_s: FloatArray) -> None:
    for run in unbroken(flags):
        if time_s[run][-1] - time_s[run.start] < _SHORTEST_S:
            flags[run] = False


def floor_level(xyz: FloatArray, root: FloatArray, contact: BoolArray, skeleton: Skeleton) -> float:
    """Height of the floor: below the ankles that stand, as far as ankles are above soles."""
    feet = (xyz[:, foot_joints(skeleton)] + root[:, None])[..., 1]
    height = np.nanmedian(feet[contact]) if contact.any() else np.nanquantile(feet, 0.05)
    return float(height) - ANKLE_ABOVE_FLOOR_MM


# Of the one body (0.039 of its height, Drillis and Contini).
ANKLE_ABOVE_FLOOR_MM = 65.0


def _filled(root: FloatArray) -> FloatArray:
    known = np.isfinite(root).all(axis=1)
    rows = np.arange(len(root))
    return np.stack([np.interp(rows, rows[known], root[known, a]) for a in range(3)], axis=1)
