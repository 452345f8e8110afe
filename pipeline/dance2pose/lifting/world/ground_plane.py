"""World axes with a level floor, for the dancers that one camera saw.

The dancers are turned by the camera's tilt (`camera_tilt`) and put on the floor by their feet. Feet
on the floor in turn tell, beside the size of the figure, how far away the dancer is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose import skeleton as skeletons
from dance2pose.lifting.world.camera_tilt import camera_tilt_deg
from dance2pose.lifting.world.contact import (
    feet_in_world,
    firmness,
    foot_joints,
    known_runs,
    standing_feet,
)
from dance2pose.lifting.world.path_solver import ACROSS_MM, ALONG_MM, Floor, solve_path
from dance2pose.lifting.world.root_trajectory import ANKLE_ABOVE_FLOOR_MM, floor_level
from dance2pose.poses import BoolArray, FloatArray, Track3D
from dance2pose.skeleton import Skeleton

# A foot that stands is on the floor unless it is this far from it: a step, a chair, a mistake.
_ON_FLOOR_MM = 120.0
# A foot farther than this below the floor, mm, is on no floor that was found.
_OTHER_FLOOR_MM = 250.0
# Floors of two dancers are one where they differ by no more than this part of the camera's height
# above them (people's heights differ by so much, and with them all that is measured by them), and
# this much more, mm.
_ONE_FLOOR, _ONE_FLOOR_MM = 0.25, 150.0
# How far off the floor standing ankles may stay, as a part of how far they were found off it, and
# the least and the most, mm: with good poses the floor tells the distance, with bad ones it would
# move the dancer away from where the picture shows him.
_PINNED, _ANKLE_ERROR_MM = 0.5, (10.0, 40.0)
# How far off a camera that turns leaves the path, mm: it is carried by hand as well, and what turns
# it by a degree too little puts a dancer three metres away 50 mm too low.
_TURNING_MM = 50.0
# How far off a figure's distance is, as a multiple of how far off its joints are.
_AS_JOINTS = 1.0
# How much lower than that of a foot flat on the floor an ankle may be: people differ.
_LOWER_MM = 15.0


def levelled(tracks: Sequence[Track3D], mm_per_unit: float) -> list[Track3D]:
    """The tracks of one camera in world axes: y up from the floor, z level towards the camera.

    Tracks whose path is in camera axes (x right, y up, z towards the viewer, camera at 0) are
    turned by the camera's tilt and put on the floor, where their feet stand on it and do not sink.
    Dancers whose own floors are about equally far below the camera are all put at y = 0 by their
    own feet; a dancer whose floor is clearly a higher one stays above. Tracks without a path stay
    in the camera's axes.
    """
    placed = [track for track in tracks if track.root is not None]
    tilt = camera_tilt_deg(placed, mm_per_unit)
    turn = Rotation.from_euler("x", -tilt, degrees=True).as_matrix()
    turned = [_turned(track, turn) for track in placed]
    found = [_on_own_floor(track, mm_per_unit) for track in turned]
    shifts = _shifts(np.array([floor for _, floor in found]), mm_per_unit)
    on_floor = [_shifted(track, shift) for (track, _), shift in zip(found, shifts, strict=True)]
    for track, (_, floor), shift in zip(on_floor, found, shifts, strict=True):
        _put_toes_on_floor(track, floor + shift)
    level = iter(on_floor)
    return [track if track.root is None else next(level) for track in tracks]


def floor_heights(tracks: Sequence[Track3D], mm_per_unit: float) -> list[float]:
    """Height of the floor that each dancer stands on, in the tracks' unit; NaN without a path."""
    return [
        float("nan")
        if track.root is None
        else _floor(track, standing_feet(track, mm_per_unit), mm_per_unit)
        for track in tracks
    ]


def _turned(track: Track3D, turn: FloatArray) -> Track3D:
    assert track.root is not None
    seen = None if track.viewpoint is None else track.viewpoint.moved(turn, np.zeros(3))
    return replace(track, xyz=track.xyz @ turn.T, root=track.root @ turn.T, viewpoint=seen)


def _shifted(track: Track3D, shift: float) -> Track3D:
    assert track.root is not None
    up = np.array([0.0, shift, 0.0])
    seen = None if track.viewpoint is None else track.viewpoint.moved(np.eye(3), up)
    return replace(track, root=track.root + up, viewpoint=seen)


def _put_toes_on_floor(track: Track3D, floor: float) -> None:
    """Turn toes that no keypoint saw up to the floor where they are below it, in the track itself:
    its poses, which `_turned` made, are nobody else's, and an hour's are 44 MB."""
    assert track.root is not None
    tree, xyz = skeletons.get(track.skeleton), track.xyz
    for joint, ankle in zip(_toes(tree), foot_joints(tree), strict=False):
        toe = xyz[:, joint] - xyz[:, ankle]
        depth = floor - track.root[:, 1] - xyz[:, ankle, 1]  # of the floor under the ankle
        length, flat = np.linalg.norm(toe, axis=1), np.hypot(toe[:, 0], toe[:, 2])
        rows = track.estimated[:, joint] & (toe[:, 1] < depth) & (np.abs(depth) < length)
        rows &= flat > 0
        reach = np.sqrt(np.maximum(length**2 - depth**2, 0.0)) / np.where(flat > 0, flat, 1.0)
        raised = np.stack([toe[:, 0] * reach, depth, toe[:, 2] * reach], axis=1)
        xyz[rows, joint] = (xyz[:, ankle] + raised)[rows]


def _toes(tree: Skeleton) -> list[int]:
    return [tree.index(name) for name in ("left_toe", "right_toe") if name in tree.joints]


def _on_own_floor(track: Track3D, mm_per_unit: float) -> tuple[Track3D, float]:
    """The track, camera at 0, with its feet on its floor, and the height of that, in its unit."""
    assert track.root is not None
    stands = standing_feet(track, mm_per_unit)
    floor = _floor(track, stands, mm_per_unit)
    if not stands.any() or not np.isfinite(floor):
        return track, floor
    tree, root = skeletons.get(track.skeleton), track.root.copy()
    turns = track.viewpoint is not None and track.viewpoint.moves
    error = _ankle_error(track, stands, floor, mm_per_unit)
    for rows in known_runs(track):
        feet, path = track.xyz[rows, foot_joints(tree)] * mm_per_unit, root[rows] * mm_per_unit
        firm = firmness(feet + path[:, None], track.time_s[rows])
        ankle = floor * mm_per_unit + ANKLE_ABOVE_FLOOR_MM
        high = feet[..., 1] + path[:, None, 1] - ankle
        least = _least_height(track.xyz[rows, :, 1] * mm_per_unit, track.estimated[rows], tree)
        least[path[:, 1] - ankle < least - _OTHER_FLOOR_MM] = -np.inf
        path = solve_path(
            path,
            feet,
            np.where(np.abs(high) < _ON_FLOOR_MM, firm, 0.0),
            track.time_s[rows],
            floor=Floor(np.array([0.0, 1.0, 0.0]), ankle, error),
            least=least,
            along_mm=_distance_error(track, mm_per_unit)[rows],
            across_mm=_TURNING_MM if turns else ACROSS_MM,
        )
        root[rows] = path / mm_per_unit
    seen = track.viewpoint
    if seen is not None and turns:
        seen = seen.aimed(track.root, root)
    return replace(track, root=root, viewpoint=seen), floor


def _distance_error(track: Track3D, mm_per_unit: float) -> FloatArray:
    """How far off (T,) the distance is that the size of the figure tells, mm."""
    if track.sigma is None:
        return np.full(len(track), ALONG_MM)
    with np.errstate(invalid="ignore"):
        return np.asarray(_AS_JOINTS * track.sigma.mean(axis=1) * mm_per_unit)


def _ankle_error(track: Track3D, stands: BoolArray, floor: float, mm_per_unit: float) -> float:
    """How far off the floor ankles that stand are found, mm: what their poses are worth."""
    assert track.root is not None
    joints = foot_joints(skeletons.get(track.skeleton))
    high = track.xyz[:, joints, 1] + track.root[:, None, 1] - floor
    off = np.abs(high[stands] * mm_per_unit - ANKLE_ABOVE_FLOOR_MM)
    spread = float(np.median(off)) / 0.6745 if len(off) else 0.0
    return float(np.clip(_PINNED * spread, *_ANKLE_ERROR_MM))


def _floor(track: Track3D, stands: BoolArray, mm_per_unit: float) -> float:
    assert track.root is not None
    if not np.isfinite(track.root).all(axis=1).any():
        return float("nan")
    feet = feet_in_world(track, slice(None), mm_per_unit)
    return floor_level(feet[..., 1], stands) / mm_per_unit


def _least_height(height: FloatArray, estimated: BoolArray, tree: Skeleton) -> FloatArray:
    """How far (T,) the pelvis must be above standing ankles for no joint to be below the floor.

    height: (T, J) of the joints above the pelvis, mm. A joint that was not seen is not sure enough
    to lift the dancer.
    """
    below = np.where(estimated, np.inf, height)
    joints = foot_joints(tree)
    below[:, joints] -= ANKLE_ABOVE_FLOOR_MM - _LOWER_MM
    return np.asarray(-(below.min(axis=1)) - ANKLE_ABOVE_FLOOR_MM)


def _shifts(floors: FloatArray, mm_per_unit: float) -> FloatArray:
    """What (N,) brings each dancer's floor, heights (N,) with the camera at 0, to its place.

    y = 0 is the lowest floor; a dancer whose floor is about there is put there, one whose floor is
    another stays above by the difference.
    """
    if not np.isfinite(floors).any():
        return np.zeros(len(floors))
    lowest = float(np.nanmin(floors))
    tolerance = _ONE_FLOOR * abs(lowest) + _ONE_FLOOR_MM / mm_per_unit
    one = np.nan_to_num(floors, nan=lowest) - lowest <= tolerance
    return np.where(one, -np.nan_to_num(floors, nan=lowest), -lowest)
