"""A perspective camera turned towards the dancer, and the way back into the room.

Poses are lifted as a camera sees them that points at the dancer, so that they look alike wherever
in the picture they are. Here that camera is made from the one that stood in the room, which may
itself turn and zoom; and what was found is turned back and put where it must stand.

T frames, J joints; axes x right, y up, z towards the viewer, of the shot's first frame; mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.temporal.smoothness import smooth_path
from dance2pose.lifting.world.perspective import (
    PerspectiveCamera,
    camera_of,
    seen_straight,
    towards,
)
from dance2pose.lifting.world.root_trajectory import follow_floor
from dance2pose.lifting.world.standing_place import place
from dance2pose.poses import FloatArray, IntArray

# Of the errors of distance, what counts beside those of other things that are known of the path
# (0.25 to 1 are alike on held-out takes).
_LASTING = 0.7


@dataclass(frozen=True)
class PointedView:
    """xy: (T, J, 2) px from the middle of the pointed camera's picture. camera: of the shot's first
    frame. turn: (T, 3, 3) axes of the pointed camera from the first frame's. frame_turn: (T, 3, 3)
    axes of the first frame from each frame's, None where the camera stands still."""

    xy: FloatArray
    camera: PerspectiveCamera
    turn: FloatArray
    frame_turn: FloatArray | None


def pointed_at_dancer(observed: Observed) -> PointedView | None:
    """The track as a camera would see it that follows the dancer; None where nothing is seen."""
    camera = camera_of(observed.image_size, observed.fov_deg)
    frame_xy, frame_turn = observed.xy, None
    if observed.motion is not None and observed.motion.moves:
        frame_turn = observed.motion.rotation
        zoom = observed.motion.zoom[:, None, None]
        frame_xy = camera.centre + (observed.xy - camera.centre) / zoom
    direction = camera.rays(_middle(frame_xy))
    if frame_turn is not None:
        direction = (frame_turn @ direction[..., None])[..., 0]
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    known = np.isfinite(direction).all(axis=1)
    if not known.any():
        return None
    times = np.arange(len(observed)) * 1.0 if observed.independent else observed.time_s
    direction = np.stack(
        [np.interp(times, times[known], direction[known, axis]) for axis in range(3)], axis=1
    )
    if not observed.independent:
        direction = smooth_path(direction, np.array(0.02), times, acceleration=1.0)
    turn = towards(direction)
    from_frame = turn if frame_turn is None else turn @ frame_turn
    xy = seen_straight(camera, frame_xy, from_frame)
    return PointedView(xy, camera, turn, frame_turn)


def placed(
    view: PointedView, observed: Observed, lifted: Lifted, stretches: Sequence[IntArray]
) -> Lifted:
    """What was lifted, turned back from the pointed camera, with its path through the room.

    stretches: rows that follow each other in time, along which feet that stand do not slide.
    """
    xyz, tree = lifted.xyz @ view.turn, skeletons.get(observed.skeleton)
    root: FloatArray = np.full((len(observed), 3), np.nan)
    along: FloatArray = np.full(len(observed), np.nan)
    if lifted.errors is not None:
        flat, confidence = view.xy / view.camera.focal_px, np.clip(observed.confidence, 0.0, 1.0)
        stands = place(lifted.xyz, flat, confidence, lifted.errors, tree)
        root, along = (stands.at[:, None] @ view.turn)[:, 0], _LASTING * stands.along
    for rows in stretches:
        if np.isfinite(root[rows]).any():
            root[rows] = follow_floor(
                xyz[rows], root[rows], observed.time_s[rows], tree, along[rows]
            )
    projected = view.camera.project(_in_frame(view, xyz + root[:, None]))
    if view.frame_turn is not None:
        assert observed.motion is not None
        zoom = observed.motion.zoom[:, None, None]
        projected = view.camera.centre + (projected - view.camera.centre) * zoom
    return replace(lifted, xyz=xyz, projected=projected, root=root)


def _in_frame(view: PointedView, xyz: FloatArray) -> FloatArray:
    """Positions (T, J, 3) in each frame's own camera axes."""
    return xyz if view.frame_turn is None else xyz @ view.frame_turn


def _middle(xy: FloatArray) -> FloatArray:
    """The middle (T, 2) of the joints seen, NaN where none is."""
    seen = np.isfinite(xy).all(axis=-1, keepdims=True)
    total = np.where(seen, xy, 0.0).sum(axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / seen.sum(axis=1))
