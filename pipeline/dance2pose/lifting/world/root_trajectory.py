"""The dancer's path through the room: feet that stand do not slide.

T frames; axes x right, y up, z towards the viewer; mm.
"""

from __future__ import annotations

import numpy as np

from dance2pose.lifting.world.contact import firmness, foot_joints
from dance2pose.lifting.world.path_solver import ALONG_MM, solve_path
from dance2pose.lifting.world.uprightness import above_feet, upright_frames
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import Skeleton

# How far away a dancer is in a frame that does not tell it.
_NOT_SEEN_MM = 1000.0
_ROUNDS = 2
# Of the one body (0.039 of its height, Drillis and Contini).
ANKLE_ABOVE_FLOOR_MM = 65.0


def follow_floor(
    xyz: FloatArray,
    root: FloatArray,
    time_s: FloatArray,
    skeleton: Skeleton,
    along_mm: FloatArray | float = ALONG_MM,
) -> FloatArray:
    """The path (T, 3) near `root` along which standing feet do not slide.

    xyz: (T, J, 3) poses with the first joint at the origin. root: (T, 3) found frame by frame, NaN
    where it could not be; the camera at the origin. along_mm: its error along the view, (T,) or one
    for all. See `path_solver`.
    """
    seen, feet = _filled(root), xyz[:, foot_joints(skeleton)]
    along = np.where(np.isfinite(root[:, 0]), along_mm, _NOT_SEEN_MM)
    above = above_feet(xyz, skeleton)
    up = above[upright_frames(above)].mean(axis=0)
    up = up / np.linalg.norm(up)
    path = solve_path(seen, feet, np.zeros(feet.shape[:2]), time_s, along_mm=along)
    for _ in range(_ROUNDS):
        firm = firmness(feet + path[:, None], time_s, up)
        path = solve_path(seen, feet, firm, time_s, along_mm=along)
    return path


def floor_level(ankles: FloatArray, contact: BoolArray) -> float:
    """Height of the floor: below the ankles that stand, as far as ankles are above soles.

    ankles: (T, 2) heights. contact: (T, 2) which stand.
    """
    height = np.nanmedian(ankles[contact]) if contact.any() else np.nanquantile(ankles, 0.05)
    return float(height) - ANKLE_ABOVE_FLOOR_MM


def _filled(root: FloatArray) -> FloatArray:
    known = np.isfinite(root).all(axis=1)
    rows = np.arange(len(root))
    return np.stack([np.interp(rows, rows[known], root[known, a]) for a in range(3)], axis=1)
