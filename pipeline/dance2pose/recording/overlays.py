"""What a recording draws besides keypoints and joints: what is not known, and what is meant.

In the picture: the 3D skeleton as the camera would see it, keypoints that were filled in. In the
world: joints that no keypoint saw, balls of uncertainty, feet that stand, the way a dancer faces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.lifting.world.contact import foot_joints, standing_feet
from dance2pose.portions import track_rows
from dance2pose.poses import BoolArray, Dancer, FloatArray, Track3D
from dance2pose.recording.quiet_rerun import rr
from dance2pose.skeleton import get

# Length of the arrow that shows the way a dancer faces, in either unit.
_ARROW = 0.35
# Frames of each dancer, about, that tell which part of the world is danced in.
_PLACES = 20_000
# Sends columns of one entity, by the last part of its path.
Send = Callable[[str, rr.ComponentColumnList], None]


def drawn_over_picture(dancer: Dancer) -> tuple[FloatArray, BoolArray] | None:
    """The bones (T, B, 2, 2) px where the camera sees the 3D skeleton, and which of them (T, B) are
    known from keypoints; None where the camera is not known."""
    track = dancer.smoothed
    if track.viewpoint is None or track.root is None:
        return None
    bones = np.array(get(track.skeleton).bones)
    seen = track.viewpoint.project(track.world_xyz)[:, bones]
    return seen, known_bones(track) & np.isfinite(seen).all(axis=(2, 3))


def known_bones(track: Track3D) -> BoolArray:
    """Which bones (T, B) have two ends that keypoints saw."""
    parents, children = np.array(get(track.skeleton).bones).T
    known = np.isfinite(track.xyz).all(axis=2) & ~track.estimated
    return np.asarray(known[:, parents] & known[:, children])


def known_joints(track: Track3D) -> FloatArray:
    """(T, J, 3) places of the joints that keypoints saw, NaN for the others."""
    return np.asarray(np.where(track.estimated[..., None], np.nan, track.world_xyz))


def guessed_bones(track: Track3D) -> list[FloatArray]:
    """For each frame, the (N, 2, 3) bones of which an end comes from the body model alone."""
    bones = track.world_xyz[:, np.array(get(track.skeleton).bones)].astype(np.float32)
    drawn = np.isfinite(bones).all(axis=(2, 3)) & ~known_bones(track)
    return [bones[row, drawn[row]] for row in range(len(bones))]


@dataclass(frozen=True)
class Ground:
    """What whole tracks tell of the ground. stands: (T, 2) which feet stand. floor: its height."""

    stands: BoolArray
    floor: float


def standing(track: Track3D) -> BoolArray:
    """Which feet (T, 2), left and right, stand; none where the path is not known."""
    if track.root is None:
        return np.zeros((len(track), 2), np.bool_)
    return standing_feet(track, BODY_HEIGHT_MM if track.unit == "body heights" else 1000.0)


def feet_on_floor(track: Track3D, stands: BoolArray) -> FloatArray:
    """(T, 2, 3) where the left and the right foot stand, NaN where they do not."""
    feet = _feet(track)
    return np.asarray(np.where(stands[..., None], feet, np.nan))


def _feet(track: Track3D) -> FloatArray:
    """(T, 2, 3) the left and the right foot in the world."""
    feet = track.xyz[:, foot_joints(get(track.skeleton))]
    return feet if track.root is None else feet + track.root[:, None]


def facing(track: Track3D) -> FloatArray:
    """(T, 3) level unit vectors to where hips and shoulders face, NaN where that is not known."""
    tree = get(track.skeleton)
    across = sum(
        track.xyz[:, tree.index(f"left_{part}")] - track.xyz[:, tree.index(f"right_{part}")]
        for part in ("hip", "shoulder")
    )
    ahead = np.cross(across, [0.0, 1.0, 0.0])
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(length > 1e-6, ahead / length, np.nan))


def floor_under(track: Track3D) -> float:
    """Height of the floor beneath the dancer."""
    feet = _feet(track)[..., 1]
    if track.root is not None:
        return 0.0 if np.nanmin(feet, initial=0.0) < 0.5 else float(np.nanmin(feet))
    return float(np.nanmin(feet)) if np.isfinite(feet).any() else 0.0


def facing_arrow(track: Track3D, floor: float) -> tuple[FloatArray, FloatArray]:
    """Origins and vectors (T, 3) of arrows on the floor beneath the dancer."""
    origin = track.xyz[:, 0] + (0.0 if track.root is None else track.root)
    origin[:, 1] = floor
    return origin, _ARROW * facing(track)


def send_columns_of(dancer: Dancer, ground: Ground, send: Send) -> None:
    """Everything drawn in the world besides joints and raw poses."""
    track = dancer.smoothed
    strips = guessed_bones(track)
    flat = np.concatenate(strips) if strips else np.zeros((0, 2, 3), np.float32)
    send("guessed", rr.LineStrips3D.columns(strips=flat).partition([len(s) for s in strips]))
    if dancer.raw.sigma is not None:
        radii = np.repeat(np.nan_to_num(dancer.raw.sigma)[..., None], 3, axis=-1)
        known = np.isfinite(known_joints(track)).all(axis=2)
        balls = rr.Ellipsoids3D.columns(
            centers=track.world_xyz[known].astype(np.float32),
            half_sizes=radii[known].astype(np.float32),
        )
        send("sigma", balls.partition(known.sum(axis=1)))
    feet = feet_on_floor(track, ground.stands)
    stands = np.isfinite(feet).all(axis=2)
    columns = rr.Points3D.columns(positions=feet[stands].astype(np.float32))
    send("contact", columns.partition(stands.sum(axis=1)))
    origin, vector = facing_arrow(track, ground.floor)
    known_way = np.isfinite(origin).all(axis=1) & np.isfinite(vector).all(axis=1)
    arrows = rr.Arrows3D.columns(
        origins=origin[known_way].astype(np.float32), vectors=vector[known_way].astype(np.float32)
    )
    send("facing", arrows.partition(known_way.astype(int)))


def ruler(points: FloatArray, unit: str) -> tuple[list[FloatArray], FloatArray, list[str]]:
    """Axes with numbers on the floor about points (N, 3): lines, places of labels, and labels.

    x runs along the front of what the points fill, z along its left, y up from that corner.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return [], np.zeros((0, 3)), []
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    start, stop = np.floor(low * 2) / 2, np.ceil(high * 2) / 2
    corner = np.array([start[0], 0.0, stop[2]])
    short = "m" if unit == "metres" else "bh"
    lines, places, labels = [], [], []
    for axis, end in ((0, stop[0]), (1, stop[1]), (2, start[2])):
        first = 0.0 if axis == 1 else corner[axis]
        last = np.where(np.arange(3) == axis, end, corner)
        lines.append(np.stack([corner, last]))
        step = 0.5 if abs(end - first) <= 4 else 1.0 if abs(end - first) <= 10 else 5.0
        ticks = np.arange(np.ceil(min(first, end) / step), np.floor(max(first, end) / step) + 1)
        for value in ticks * step:
            places.append(np.where(np.arange(3) == axis, value, corner))
            labels.append(f"{'xyz'[axis]} {value:g} {short}")
    return lines, np.array(places).reshape(-1, 3), labels


def all_positions(dancers: Sequence[Dancer], offsets: FloatArray) -> FloatArray:
    """(N, 3) places of all joints of all dancers, as they are shown; of a long track, in every
    n-th frame."""
    shown = []
    for dancer, offset in zip(dancers, offsets, strict=True):
        every = slice(None, None, 1 + len(dancer.smoothed) // _PLACES)
        shown.append((track_rows(dancer.smoothed, every).world_xyz + offset).reshape(-1, 3))
    return np.concatenate(shown)
