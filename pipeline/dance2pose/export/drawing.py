"""Skeletons drawn into pictures: keypoints over the film, and joints in a room beside it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dance2pose.poses import FloatArray, Image
from dance2pose.recording.style import dancer_colour, side_colour
from dance2pose.skeleton import Skeleton, body_keypoints

Colour = tuple[int, int, int]

_GROUND, _GRID = (28, 24, 22), (70, 64, 60)
# From where the room is seen: turned to the side and raised, so that depth shows.
_TURN, _RISE = np.radians(25.0), np.radians(12.0)
_MARGIN = 1.15
_GRID_STEP = 0.5
_HALO: Colour = (20, 20, 20)


def draw_skeleton(image: Image, xy: FloatArray, skeleton: Skeleton, person: int) -> None:
    """Draw points (J, 2) px and the lines of the skeleton between those that are known."""
    size = max(1, round(min(image.shape[:2]) / 240))
    body = len(body_keypoints(skeleton.name))
    bones = [(a, b) for a, b in skeleton.bones if np.isfinite(xy[[a, b]]).all()]
    for width, dark in ((size + 2, True), (size, False)):
        for a, b in bones:
            colour = _HALO if dark else joint_colour(skeleton.joints[b], person)
            cv2.line(image, _pixel(xy[a]), _pixel(xy[b]), colour, width, cv2.LINE_AA)
    for joint, place in enumerate(xy):
        if np.isfinite(place).all():
            colour = joint_colour(skeleton.joints[joint], person)
            radius = size + 1 if joint < body else size
            cv2.circle(image, _pixel(place), radius, colour, -1, cv2.LINE_AA)


def joint_colour(joint: str, person: int) -> Colour:
    """Blue, green, red: by the side of the body, the dancer's own colour in the middle."""
    red, green, blue = side_colour(joint, dancer_colour(person))
    return blue, green, red


def _pixel(place: FloatArray) -> tuple[int, int]:
    x, y = np.clip(np.rint(place), -32768, 32767)
    return int(x), int(y)


@dataclass(frozen=True)
class Room:
    """The view of a room of a given extent, seen without perspective.

    size: (width, height) px. centre: (3,), and scale: px a unit.
    """

    size: tuple[int, int]
    centre: FloatArray
    scale: float
    low: FloatArray
    high: FloatArray

    @classmethod
    def around(cls, points: FloatArray, size: tuple[int, int]) -> Room:
        """A view of everything in points (N, 3) but their wildest hundredth."""
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            points = np.zeros((1, 3))
        low, high = np.percentile(points, [0.5, 99.5], axis=0)
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        centre = (low + high) / 2
        flat = _turned(low + corners * (high - low) - centre)
        extent = np.maximum(np.ptp(flat[:, :2], axis=0) * _MARGIN, 0.5)
        return cls(size, centre, float(min(size / extent)), low, high)

    def project(self, points: FloatArray) -> FloatArray:
        """(..., 3) places in the world as (..., 2) px."""
        flat = _turned(points - self.centre) * self.scale
        middle = np.array(self.size) / 2
        return np.stack([middle[0] + flat[..., 0], middle[1] - flat[..., 1]], axis=-1)

    def empty(self) -> Image:
        """The room with nobody in it: its floor as a grid of half units."""
        width, height = self.size
        image: Image = np.full((height, width, 3), _GROUND, np.uint8)
        floor = self.low[1]
        xs, zs = (
            np.arange(np.floor(a / _GRID_STEP), np.ceil(b / _GRID_STEP) + 1) * _GRID_STEP
            for a, b in zip(self.low[[0, 2]] - 0.25, self.high[[0, 2]] + 0.25, strict=True)
        )
        ends = [((x, floor, zs[0]), (x, floor, zs[-1])) for x in xs]
        ends += [((xs[0], floor, z), (xs[-1], floor, z)) for z in zs]
        for pair in ends:
            a, b = self.project(np.array(pair))
            cv2.line(image, _pixel(a), _pixel(b), _GRID, 1, cv2.LINE_AA)
        return image


def _turned(points: FloatArray) -> FloatArray:
    """Points as seen: x right, y up, z towards the eye."""
    c, s = np.cos(_TURN), np.sin(_TURN)
    x, z = c * points[..., 0] - s * points[..., 2], s * points[..., 0] + c * points[..., 2]
    c, s = np.cos(_RISE), np.sin(_RISE)
    y = c * points[..., 1] - s * z
    return np.stack([x, y, s * points[..., 1] + c * z], axis=-1)
