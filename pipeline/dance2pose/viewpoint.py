"""Where the camera stood and how it looked, frame by frame, in the world of the poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Viewpoint:
    """A perspective camera in the world of a track of T frames.

    Camera axes are x right, y up, z towards the viewer, so that everything seen has negative z.

    Parameters
    ----------
    rotation : (T, 3, 3)
        World axes from camera axes: a direction d in the picture is ``rotation @ d`` in the world.
    position : (3,)
        Where the camera stands, in the unit of the poses.
    focal_px : (T,)
        Focal length; pixels are square.
    image_size : (width, height)
        Of the picture, px; its middle is the principal point.
    fov_error_deg : float, optional
        Standard deviation of the field of view where the picture told it, else None.

    Examples
    --------
    >>> ahead = Viewpoint(np.eye(3)[None], np.zeros(3), np.array([100.0]), (101, 51))
    >>> ahead.project(np.array([[[0.0, 1.0, -4.0]]]))
    array([[[50.,  0.]]])
    """

    rotation: FloatArray
    position: FloatArray
    focal_px: FloatArray
    image_size: tuple[int, int]
    fov_error_deg: float | None = None

    def __post_init__(self) -> None:
        frames = len(self.focal_px)
        if self.rotation.shape != (frames, 3, 3) or self.position.shape != (3,):
            raise ValueError(
                f"rotation has shape {self.rotation.shape} and position {self.position.shape}, "
                f"expected {(frames, 3, 3)} and (3,)"
            )

    def __len__(self) -> int:
        return len(self.focal_px)

    @property
    def fov_deg(self) -> float:
        """Field of view across the longer side of the first frame, degrees."""
        half = max(self.image_size) / 2 / float(self.focal_px[0])
        return float(2 * np.degrees(np.arctan(half)))

    @property
    def moves(self) -> bool:
        """Whether it turns or zooms."""
        return bool(
            len(self) and ((self.rotation != self.rotation[0]).any() or np.ptp(self.focal_px) > 0)
        )

    def project(self, world: FloatArray) -> FloatArray:
        """Image points (T, J, 2) px, y down, of places (T, J, 3); NaN behind the camera."""
        seen = (world - self.position) @ self.rotation
        ahead = np.where(seen[..., 2:] < 0, -seen[..., 2:], np.nan)
        middle = (np.array(self.image_size) - 1) / 2
        flat = self.focal_px[:, None, None] * seen[..., :2] / ahead
        return np.asarray(middle + flat * np.array([1.0, -1.0]))

    def aimed(self, before: FloatArray, after: FloatArray) -> Viewpoint:
        """The same camera turned so that places (T, 3) are seen where others were seen before."""
        known = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
        rotation = self.rotation.copy()
        turn = _between((before - self.position)[known], (after - self.position)[known])
        rotation[known] = turn @ rotation[known]
        return replace(self, rotation=rotation)

    def moved(self, turn: FloatArray, shift: FloatArray) -> Viewpoint:
        """The same camera where the world is turned by `turn` (3, 3) and then shifted by (3,)."""
        return replace(self, rotation=turn @ self.rotation, position=turn @ self.position + shift)


def _between(one: FloatArray, other: FloatArray) -> FloatArray:
    """The smallest rotations (N, 3, 3) that turn directions (N, 3) into others."""
    a = one / np.linalg.norm(one, axis=1, keepdims=True)
    b = other / np.linalg.norm(other, axis=1, keepdims=True)
    x, y, z = np.cross(a, b).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    cosine = (a * b).sum(axis=1)[:, None, None]
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cosine))
