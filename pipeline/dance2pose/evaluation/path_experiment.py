"""The dancer's path through the room, seen by a perspective camera: error, foot-slide and floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.evaluation.cameras import IMAGE_SIZE, rotation
from dance2pose.evaluation.metrics import foot_slide, mean_over, true_contacts
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.lifting.lift import lift_in_camera
from dance2pose.lifting.world.camera_tilt import camera_tilt_deg
from dance2pose.lifting.world.ground_plane import levelled
from dance2pose.lifting.world.root_trajectory import ANKLE_ABOVE_FLOOR_MM
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import BoolArray, FloatArray, Timeline, Track2D, Track3D
from dance2pose.progress import Progress

FOV_DEG = 50.0
LOWEST_MM, HIGHEST_MM = 600.0, 2200.0  # that the camera stands
NEAREST_MM = 3500.0  # of the dancer to the camera
_AIM_MM = 950.0  # above the floor
SUNK_MM = 30.0


@dataclass(frozen=True)
class _Room:
    """world: (T, J, 3) mm, x right, y up from the floor, z towards the camera's side. tilt_deg:
    how far the camera looks down. track: what it sees."""

    world: FloatArray
    tilt_deg: float
    track: Track2D


def _room(take: Take, azimuth_deg: float, height_mm: float) -> _Room:
    """The whole path before a camera far enough away to see all of it, pointed at its middle."""
    assert take.root is not None
    world = (take.xyz + take.root[:, None]) @ rotation(azimuth_deg, 0.0).T
    ankles = world[:, _feet(take.skeleton), 1]
    world -= np.array([world[..., 0].mean(), np.quantile(ankles, 0.02), world[..., 2].max()])
    width, height = IMAGE_SIZE
    focal = width / 2 / np.tan(np.radians(FOV_DEG) / 2)
    distance = max(NEAREST_MM, np.abs(world[..., 0]).max() / (0.9 * width / 2 / focal))
    tilt = np.degrees(np.arctan2(height_mm - _AIM_MM, distance - world[:, 0, 2].mean()))
    position = (world - np.array([0.0, height_mm, distance])) @ rotation(0.0, tilt).T
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    xy = middle + focal * position[..., :2] * [1.0, -1.0] / -position[..., 2:]
    frames = len(xy)
    track = Track2D(
        person=1,
        timeline=Timeline(np.arange(frames), np.arange(frames) / take.rate_hz),
        xy=xy,
        confidence=np.ones(xy.shape[:2]),
        skeleton=take.skeleton,
        interpolated=np.zeros(frames, bool),
        box=np.full((frames, 4), np.nan),
        image_size=IMAGE_SIZE,
    )
    return _Room(world, float(tilt), track)


def _feet(skeleton: str) -> list[int]:
    tree = skeletons.get(skeleton)
    return [tree.index("left_ankle"), tree.index("right_ankle")]


def _positions(track: Track3D) -> FloatArray:
    assert track.root is not None
    return np.asarray(track.world_xyz * BODY_HEIGHT_MM)


def path_table(takes: Sequence[Take], settings: EvaluationSettings, progress: Progress) -> Table:
    """Foot-slide and error of the path: the truth, frame by frame, and the default lifter."""
    rows: dict[str, list[tuple[float, ...]]] = {
        "truth": [],
        "frame by frame, tilt known": [],
        "default": [],
    }
    with_path = [take for take in takes if take.root is not None]
    for number, take in enumerate(
        progress.track(with_path, "path", total=len(with_path), unit="take")
    ):
        rng = np.random.default_rng((settings.seed, number))
        azimuth, height = rng.uniform(0, 360), rng.uniform(LOWEST_MM, HIGHEST_MM)
        at_rate = resample(take, settings.rate_hz) if take.rate_hz > settings.rate_hz else take
        room = _room(at_rate, azimuth, height)
        contact = true_contacts(room.world[:, _feet(take.skeleton)], at_rate.rate_hz)
        (alone,) = lift_in_camera([room.track], fov_deg=FOV_DEG, independent=True)
        (seen,) = lift_in_camera([room.track], fov_deg=FOV_DEG)
        (level,) = levelled([seen], BODY_HEIGHT_MM)
        worlds = (
            (room.world, 0.0),
            (_positions(alone) @ rotation(0.0, room.tilt_deg), 0.0),
            (_positions(level), abs(camera_tilt_deg([seen], BODY_HEIGHT_MM) - room.tilt_deg)),
        )
        for found, (world, off_level) in zip(rows.values(), worlds, strict=True):
            found.append((*_measured(world, room.world, contact, take.skeleton), off_level))
    cells: list[list[Cell]] = [
        [name, *(float(mean_over(np.array(column))) for column in zip(*found, strict=True))]
        for name, found in rows.items()
    ]
    return Table(
        "path",
        "The dancer's path through the room, perspective camera of known field of view",
        (
            "",
            "foot-slide, mm a frame of contact",
            "error of the path on the floor, mm",
            "height of standing ankles, standard deviation, mm",
            "frames with a foot 30 mm under the floor",
            "floor off level, degrees",
        ),
        cells,
        note=(
            f"A camera {LOWEST_MM / 1000:g} to {HIGHEST_MM / 1000:g} m above the floor, pointed at "
            f"the middle of the path, field of view {FOV_DEG:g}°, at a random azimuth, far enough "
            f"away to see the whole path, at least {NEAREST_MM / 1000:g} m; {settings.rate_hz:g} "
            "frames a second. Contact is taken from the true motion (ankle slower than 0.15 m/s "
            "and low); the truth slides too, because ankles roll and retargeted legs do not reach "
            "exactly as far. The error is that of the pelvis after moving the whole path by its "
            "mean offset. The default lifter finds the camera's tilt itself."
        ),
    )


def _measured(
    world: FloatArray, truth: FloatArray, contact: BoolArray, skeleton: str
) -> tuple[float, float, float, float]:
    """Foot-slide, error of the path on the floor, how uneven the floor is, mm, and the share of
    frames with a foot below the median height of those that stand, less that of an ankle."""
    feet = world[:, _feet(skeleton)]
    if not np.isfinite(world).any():
        return np.nan, np.nan, np.nan, np.nan
    off = (world[:, 0] - truth[:, 0])[:, [0, 2]]
    error = float(np.nanmean(np.linalg.norm(off - np.nanmean(off, axis=0), axis=1)))
    standing = feet[..., 1][contact]
    standing = standing[np.isfinite(standing)]
    if not standing.size:
        return foot_slide(feet, contact), error, np.nan, np.nan
    joints = [*_feet(skeleton), *_toes(skeleton)]
    floor = float(np.median(standing)) - ANKLE_ABOVE_FLOOR_MM
    lowest = world[np.isfinite(world).all(axis=(1, 2))][:, joints, 1].min(axis=1)
    sunk = float((lowest < floor - SUNK_MM).mean())
    return foot_slide(feet, contact), error, float(standing.std()), sunk


def _toes(skeleton: str) -> list[int]:
    tree = skeletons.get(skeleton)
    return [tree.index(name) for name in ("left_toe", "right_toe") if name in tree.joints]
