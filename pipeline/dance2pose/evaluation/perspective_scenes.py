"""Takes before real cameras: perspective, at a height where people hold them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dance2pose.evaluation.cameras import IMAGE_SIZE, Scene, rotation
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import FloatArray

FOV_DEG = 50.0
LOWEST_MM, HIGHEST_MM = 600.0, 2200.0  # that the camera stands
NEAREST_MM = 3500.0  # of the dancer to the camera
_AIM_MM = 950.0  # above the floor
_MARGIN = 0.9  # of half the picture that the dancer's way may take up


def perspective_scenes(
    takes: Sequence[Take], *, views: int, seed: int, rate_hz: float
) -> list[Scene]:
    """Every take before `views` cameras evenly around it, each pointed at the middle of its path
    and far enough away to see all of it. Azimuths and heights come from the seed."""
    out = []
    for number, take in enumerate(takes):
        rng = np.random.default_rng((seed, number))
        first = rng.uniform(0, 360 / views)
        at_rate = resample(take, rate_hz) if take.rate_hz > rate_hz else take
        for view in range(views):
            azimuth, height = first + 360 / views * view, rng.uniform(LOWEST_MM, HIGHEST_MM)
            out.append(_scene(at_rate, azimuth, height))
    return out


def _scene(take: Take, azimuth_deg: float, height_mm: float) -> Scene:
    world = take.xyz if take.root is None else take.xyz + take.root[:, None]
    world = world @ rotation(azimuth_deg, 0.0).T
    middle = world.mean(axis=1)
    floor = np.quantile(world[..., 1].min(axis=1), 0.02)
    nearest = world[..., 2].max()
    world = world - np.array([(middle[:, 0].min() + middle[:, 0].max()) / 2, floor, nearest])
    width, height = IMAGE_SIZE
    focal = width / 2 / np.tan(np.radians(FOV_DEG) / 2)
    distance = max(
        NEAREST_MM,
        np.abs(world[..., 0]).max() * focal / (_MARGIN * width / 2),
        (world[..., 1].max() + height_mm) * focal / (_MARGIN * height),
    )
    ahead = distance - float(np.median(world[:, 0, 2]))
    tilt = float(np.degrees(np.arctan2(height_mm - _AIM_MM, ahead)))
    position: FloatArray = (world - np.array([0.0, height_mm, distance])) @ rotation(0.0, tilt).T
    usual = float(np.median(-position[:, 0, 2]))
    return Scene(
        take=take.name,
        azimuth_deg=azimuth_deg,
        tilt_deg=tilt,
        rate_hz=take.rate_hz,
        skeleton=take.skeleton,
        truth=position - position[:, :1],
        xy=usual * position[..., :2] / -position[..., 2:],
        fov_deg=FOV_DEG,
        mm_per_pixel=usual / focal,
    )
