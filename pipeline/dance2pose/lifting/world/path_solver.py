"""The most likely path of a dancer's pelvis: one linear least-squares problem over a stretch.

T frames; F feet; any axes whose origin is the camera; mm. What is known: where the pelvis was seen
frame by frame (well across the line of sight, badly along it), that bodies are slow to speed up,
that standing feet do not slide, and, once the floor is known, that they stand on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from dance2pose.lifting.temporal.smoothness import second_difference_bands
from dance2pose.poses import BoolArray, FloatArray

# Errors of the path found frame by frame, across the line of sight and along it; the size of a
# figure tells its distance far worse than its place.
ACROSS_MM = 8.0
ALONG_MM = 60.0
_SUNK_MM = 1.5  # that a foot may be below the floor
_SLIDE_MM = 1.0  # that a standing foot may move from frame to frame
_ACCELERATION = 4000.0  # mm / s^2, of the pelvis


@dataclass(frozen=True)
class Floor:
    """The floor as standing ankles show it: up @ ankle = height, give or take.

    up: (3,) unit vector. height: of standing ankles, mm. error_mm: of the ankle of a pose and of an
    even floor.
    """

    up: FloatArray
    height: float
    error_mm: float


def solve_path(
    seen: FloatArray,
    feet: FloatArray,
    contact: FloatArray | BoolArray,
    time_s: FloatArray,
    *,
    floor: Floor | None = None,
    least: FloatArray | None = None,
    along_mm: FloatArray | float = ALONG_MM,
    across_mm: float = ACROSS_MM,
) -> FloatArray:
    """The path (T, 3).

    seen: (T, 3) frame by frame. feet: (T, F, 3) ankles relative to the pelvis. contact: (T, F)
    how firmly they stand, 0 to 1. floor: where they stand, if it is known. least: (T,) how high
    above standing ankles' height the pelvis must be for no foot to be below the floor, used with
    `floor`. along_mm, across_mm: error of what was seen along the line of sight, (T,) or one for
    all, and across it.
    """
    if len(seen) < 3:
        return seen
    blocks, right = _seen_terms(seen, along_mm, across_mm)
    if floor is not None:
        across = floor.up[:, None] * floor.up / floor.error_mm**2
        missing = floor.height - feet @ floor.up
        for foot in range(feet.shape[1]):
            firm = contact[:, foot].astype(float)
            blocks += firm[:, None, None] * across
            right += np.outer(firm * missing[:, foot] / floor.error_mm**2, floor.up)
    bands, right = _banded(blocks, right, feet, contact, time_s)
    del blocks
    path = solveh_banded(bands, right.ravel()).reshape(seen.shape)
    if floor is None or least is None:
        return np.asarray(path)
    return _lifted(path, bands, right, floor, least)


def _lifted(
    path: FloatArray, bands: FloatArray, right: FloatArray, floor: Floor, least: FloatArray
) -> FloatArray:
    """The path pushed up where a foot is below the floor: an active set, grown until none is.

    bands, right: the system, which is changed.
    """
    held = np.zeros(len(path), dtype=bool)
    weight = 1 / _SUNK_MM**2
    for _ in range(8):
        below = (path @ floor.up - floor.height < least - 5.0) & ~held
        if not below.any():
            break
        held |= below
        for row in range(3):
            for column in range(row, 3):
                at = 3 * np.flatnonzero(below) + column
                bands[-1 - (column - row), at] += weight * floor.up[row] * floor.up[column]
        right[below] += weight * np.outer(least[below] + floor.height, floor.up)
        path = solveh_banded(bands, right.ravel()).reshape(path.shape)
    return np.asarray(path)


def _seen_terms(
    seen: FloatArray, along_mm: FloatArray | float, across_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Precision (T, 3, 3) of what was seen, and its product with it (T, 3)."""
    distance = np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-9)
    along = seen / distance
    less = np.broadcast_to(1 / np.square(along_mm) - 1 / across_mm**2, len(seen))
    blocks = np.eye(3) / across_mm**2 + along[:, :, None] * along[:, None] * less[:, None, None]
    return blocks, (blocks @ seen[..., None])[..., 0]


def _banded(
    blocks: FloatArray,
    right: FloatArray,
    feet: FloatArray,
    contact: FloatArray | BoolArray,
    time_s: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The whole system as upper bands (9, 3 T), unknowns frame by frame, and its right side."""
    frames = len(blocks)
    bands = np.zeros((9, 3 * frames))
    smooth = second_difference_bands(time_s) / _ACCELERATION**2
    right = right.copy()
    for axis in range(3):
        for apart in range(3):  # frames
            bands[8 - 3 * apart, axis::3] += smooth[2 - apart]
        for other in range(axis, 3):
            bands[8 - (other - axis), other::3] += blocks[:, axis, other]
    both = np.minimum(contact[1:], contact[:-1]).astype(float)
    for foot in range(feet.shape[1]):
        weight = both[:, foot] / _SLIDE_MM**2
        step = -weight[:, None] * np.diff(feet[:, foot], axis=0)
        right[1:] += step
        right[:-1] -= step
        for axis in range(3):
            bands[8, axis::3][1:] += weight
            bands[8, axis::3][:-1] += weight
            bands[5, axis::3][1:] -= weight
    return bands, right
