"""A real camera with a known field of view: which way it sees what.

Image points are pixels with y up, as in `lifted`; camera axes here are x right, y up, z towards
the viewer, so that everything seen has negative z. The principal point is the picture's centre and
pixels are square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.errors import UsageError
from dance2pose.poses import FloatArray

# Of a camcorder or phone, across the longer side of the picture; used where the user gives none.
ASSUMED_FOV_DEG = 50.0
ASSUMED_FOV = (
    f"assumed to be {ASSUMED_FOV_DEG:g} degrees across the longer side of the picture; distances "
    "towards the camera scale with it"
)


@dataclass(frozen=True)
class PerspectiveCamera:
    """focal_px: focal length. centre: (2,) principal point in px, y up."""

    focal_px: float
    centre: FloatArray

    def rays(self, xy: FloatArray) -> FloatArray:
        """Directions (..., 3) of image points (..., 2), with z = -1."""
        flat = (xy - self.centre) / self.focal_px
        return np.concatenate([flat, np.full((*xy.shape[:-1], 1), -1.0)], axis=-1)

    def project(self, xyz: FloatArray) -> FloatArray:
        """Image points (..., 2) of positions (..., 3) in front of the camera."""
        depth = np.minimum(xyz[..., 2:], -1e-9)
        return np.asarray(self.centre - self.focal_px * xyz[..., :2] / depth)


def camera_of(image_size: tuple[int, int], fov_deg: float | None) -> PerspectiveCamera:
    """The camera of a picture (width, height) px with that field of view across its longer side,
    or, where none is known, the assumed one."""
    width, height = image_size
    across, fov = max(width, height), ASSUMED_FOV_DEG if fov_deg is None else fov_deg
    if not (math.isfinite(fov) and 1 <= fov <= 170):
        raise UsageError(f"field of view of {fov} degrees; expected 1 to 170")
    focal = across / 2 / math.tan(math.radians(fov) / 2)
    return PerspectiveCamera(focal, np.array([(width - 1) / 2, -(height - 1) / 2]))


def towards(direction: FloatArray) -> FloatArray:
    """Rotations (T, 3, 3) that turn directions (T, 3) to straight ahead (0, 0, -1), no roll."""
    x, y, z = np.moveaxis(direction, -1, 0)
    pan = np.arctan2(x, -z)
    tilt = np.arctan2(y, np.hypot(x, z))
    turn = Rotation.from_euler("x", -tilt[:, None]) * Rotation.from_euler("y", pan[:, None])
    return np.asarray(turn.as_matrix())


def seen_straight(camera: PerspectiveCamera, xy: FloatArray, rotation: FloatArray) -> FloatArray:
    """Image points (T, J, 2), relative to the centre, of a camera turned by rotations (T, 3, 3)."""
    turned = camera.rays(xy) @ rotation.transpose(0, 2, 1)
    with np.errstate(invalid="ignore"):
        ahead = np.minimum(turned[..., 2:], -1e-6)
    return np.asarray(-camera.focal_px * turned[..., :2] / ahead)
