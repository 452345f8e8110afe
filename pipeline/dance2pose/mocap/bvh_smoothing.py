"""A BVH take smoothed joint by joint: rotations as rotations, positions as positions.

Euler angles jump where a joint turns past 180 degrees and cannot be averaged. They are smoothed as
unit quaternions and written back as the angles nearest to those that were there; offsets, and with
them bone lengths, stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from dance2pose.mocap.bvh import BvhFile

Float64Array = npt.NDArray[np.float64]
Smoother = Callable[[Float64Array], Float64Array]


def smoothed_channels(take: BvhFile, smooth: Smoother) -> Float64Array:
    """The take's values (T, columns), each joint smoothed over time."""
    out = take.values.copy()
    column = 0
    for names in take.channels:
        columns = range(column, column + len(names))
        column += len(names)
        moves = [c for c, name in zip(columns, names, strict=True) if name.endswith("position")]
        turns = [c for c, name in zip(columns, names, strict=True) if name.endswith("rotation")]
        if moves:
            out[:, moves] = smooth(take.values[:, moves])
        order = "".join(names[c - columns[0]][0] for c in turns)
        if len(set(order)) == 3 and len(order) == 3:
            out[:, turns] = _rotations(take.values[:, turns], order, smooth)
        elif turns:
            angles = np.unwrap(take.values[:, turns], period=360, axis=0)
            out[:, turns] = smooth(angles)
    return out


def bvh_text(take: BvhFile, values: Float64Array) -> str:
    """The take as a file with these values."""
    lines = [*take.header, "MOTION", f"Frames: {len(values)}", f"Frame Time: {take.frame_time:.9g}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in values]
    return "\n".join(lines) + "\n"


def _rotations(angles: Float64Array, order: str, smooth: Smoother) -> Float64Array:
    """Euler angles (T, 3), degrees, smoothed as quaternions of one continuous sign."""
    quaternions = Rotation.from_euler(order, angles, degrees=True).as_quat()
    turned_over = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    quaternions[1:][np.cumsum(turned_over) % 2 == 1] *= -1
    found = smooth(quaternions)
    length = np.linalg.norm(found, axis=1, keepdims=True)
    found = np.where(length > 1e-6, found, quaternions)
    return _nearest(Rotation.from_quat(found).as_euler(order, degrees=True), angles)


def _nearest(angles: Float64Array, old: Float64Array) -> Float64Array:
    """Of all angles that mean these rotations, those nearest to the old ones."""
    other = np.stack([angles[:, 0] + 180, 180 - angles[:, 1], angles[:, 2] + 180], axis=1)
    both = np.stack([angles, other])
    both += 360 * np.round((old - both) / 360)
    away = np.abs(both - old).sum(axis=2)
    return np.asarray(np.where((away[0] <= away[1])[:, np.newaxis], both[0], both[1]))
