"""World axes with a level floor, for the dancers that one camera saw.

A camera that looks down sees a floor that rises with distance. How far it looks down is told by
the dancers: bodies stand upright on average, and feet that stand, near and far, stand on one plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose import skeleton as skeletons
from dance2pose.lifting.world.root_trajectory import contacts, floor_level, foot_joints
from dance2pose.poses import FloatArray, Track3D

# A dancer is upright only about so, degrees; a plane through feet is known the better, the farther
# they are apart along the view (error in degrees times their spread in mm), and not at all where it
# contradicts the bodies.
_UPRIGHT_DEG, _PLANE_DEG_MM, _CONTRADICTION_DEG = 5.0, 1700.0, 12.0
_STEEPEST_DEG = 70.0
_FEWEST_CONTACTS = 20


def levelled(tracks: Sequence[Track3D], mm_per_unit: float) -> list[Track3D]:
    """The tracks of one camera in world axes: y up from the floor, z level towards the camera.

    Tracks whose path is in camera axes (x right, y up, z towards the viewer, camera at 0) are
    turned by the camera's tilt and put on the floor, each dancer by its own feet. Tracks without a
    path stay in the camera's axes.
    """
    placed = [track for track in tracks if track.root is not None]
    tilt = camera_tilt_deg(placed, mm_per_unit)
    turn = Rotation.from_euler("x", -tilt, degrees=True).as_matrix()
    return [
        track if track.root is None else _on_floor(track, track.root, turn, mm_per_unit)
        for track in tracks
    ]


def camera_tilt_deg(tracks: Sequence[Track3D], mm_per_unit: float) -> float:
    """How far the camera looks down, degrees; 0 where nothing tells it."""
    upright, feet = [], []
    for track in tracks:
        assert track.root is not None
        upright.append(_standing(track))
        for rows in _known_runs(track):
            stands = contacts(
                track.xyz[rows] * mm_per_unit,
                track.root[rows] * mm_per_unit,
                track.time_s[rows],
                skeletons.get(track.skeleton),
            )
            joints = foot_joints(skeletons.get(track.skeleton))
            at = track.xyz[rows][:, joints] + track.root[rows, None]
            feet.append(at[stands] * mm_per_unit)
    up = np.concatenate(upright) if upright else np.zeros((0, 3))
    if not len(up):
        return 0.0
    _, y, z = up.mean(axis=0)
    tilt = float(np.degrees(np.arctan2(z, y)))
    plane, spread = _plane_tilt_deg(np.concatenate(feet) if feet else np.zeros((0, 3)))
    if abs(plane - tilt) < _CONTRADICTION_DEG:
        weight = (_UPRIGHT_DEG * spread / _PLANE_DEG_MM) ** 2
        tilt = (tilt + weight * plane) / (1 + weight)
    return float(np.clip(tilt, -_STEEPEST_DEG, _STEEPEST_DEG))


def _standing(track: Track3D) -> FloatArray:
    """Directions (N, 3) from the ankles to the head, of the more upright half of the frames."""
    tree = skeletons.get(track.skeleton)
    ankles = track.xyz[:, foot_joints(tree)].mean(axis=1)
    along = track.xyz[:, tree.index("head")] - ankles
    length = np.linalg.norm(along, axis=1)
    known = np.isfinite(length) & (length > 0)
    if not known.any():
        return np.zeros((0, 3))
    tall = known & (length >= np.median(length[known]))
    return np.asarray(along[tall] / length[tall, None])


def _plane_tilt_deg(feet: FloatArray) -> tuple[float, float]:
    """Slope of the floor that standing feet (N, 3) mm show, degrees, and their spread in depth."""
    if len(feet) < _FEWEST_CONTACTS or (spread := float(feet[:, 2].std())) < 1.0:
        return float("nan"), 0.0
    slope = np.polyfit(feet[:, 2], feet[:, 1], 1)[0]
    return float(-np.degrees(np.arctan(slope))), spread


def _known_runs(track: Track3D) -> list[slice]:
    assert track.root is not None
    known = np.isfinite(track.root).all(axis=1) & np.isfinite(track.xyz).all(axis=(1, 2))
    edges = np.flatnonzero(np.diff(np.r_[False, known, False]))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _on_floor(track: Track3D, root: FloatArray, turn: FloatArray, mm_per_unit: float) -> Track3D:
    xyz, root = track.xyz @ turn.T, root @ turn.T
    tree = skeletons.get(track.skeleton)
    stands = np.zeros((len(root), 2), bool)
    for rows in _known_runs(track):
        stands[rows] = contacts(
            xyz[rows] * mm_per_unit, root[rows] * mm_per_unit, track.time_s[rows], tree
        )
    if np.isfinite(root).all(axis=1).any():
        floor = floor_level(xyz * mm_per_unit, root * mm_per_unit, stands, tree) / mm_per_unit
        root = root - [0.0, floor, 0.0]
    return replace(track, xyz=xyz, root=root)
