"""Directions of bones as the torso, or the bone before, sees them.

Bones are named by the joint they end at.
"""

from __future__ import annotations

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import UsageError
from dance2pose.poses import FloatArray, IntArray

BIN_DEGREES = 3
AZIMUTHS, ELEVATIONS = 360 // BIN_DEGREES, 180 // BIN_DEGREES

_SHOULDERS = ("left_shoulder", "right_shoulder")
_HIPS = ("left_hip", "right_hip")
# The limited bones, each with the line whose ends (left, right) and the spine make its torso
# frame, and the limited bones between it and the torso, innermost first.
_LIMITED: dict[str, tuple[tuple[str, str], tuple[str, ...]]] = {
    "left_elbow": (_SHOULDERS, ()),
    "right_elbow": (_SHOULDERS, ()),
    "head": (_SHOULDERS, ()),
    "left_knee": (_HIPS, ()),
    "right_knee": (_HIPS, ()),
    "left_wrist": (_SHOULDERS, ("left_elbow",)),
    "right_wrist": (_SHOULDERS, ("right_elbow",)),
    "left_ankle": (_HIPS, ("left_knee",)),
    "right_ankle": (_HIPS, ("right_knee",)),
    "left_toe": (_HIPS, ("left_knee", "left_ankle")),
    "right_toe": (_HIPS, ("right_knee", "right_ankle")),
}


def limited_bones(skeleton: str) -> tuple[str, ...]:
    """The bones of a lifting skeleton that have limits, those of the torso first."""
    known = skeletons.get(skeleton)
    if not known.is_tree:
        raise UsageError(f"skeleton {skeleton} has no bones to limit; use its lifting skeleton")
    return tuple(joint for joint in _LIMITED if joint in known.joints)


def parent_bone(bone: str) -> str | None:
    """The limited bone that selects the region of `bone`; None for one that leaves the torso."""
    chain = _LIMITED[bone][1]
    return chain[-1] if chain else None


def bins(direction: FloatArray) -> tuple[IntArray, IntArray]:
    """Azimuth and elevation bins of unit vectors (3, ...); poles are the third axis."""
    x, y, z = direction
    azimuth = np.degrees(np.arctan2(y, x)) + 180
    elevation = np.degrees(np.arcsin(np.clip(z, -1, 1))) + 90
    with np.errstate(invalid="ignore"):
        return (
            np.clip((azimuth / BIN_DEGREES).astype(np.int64), 0, AZIMUTHS - 1),
            np.clip((elevation / BIN_DEGREES).astype(np.int64), 0, ELEVATIONS - 1),
        )


def transport(p: FloatArray, reference: FloatArray, vector: FloatArray) -> FloatArray:
    """Rotate `vector` by the smallest rotation that takes unit `p` to unit `reference`.

    All are (3, ...) and broadcast. Undefined where p is opposite to reference.
    """
    middle = p + reference
    along = (middle * vector).sum(axis=0) / (1 + (p * reference).sum(axis=0))
    turned: FloatArray = vector - middle * along + 2 * (p * vector).sum(axis=0) * reference
    return turned


class BodyFrames:
    """Directions of the limited bones of poses (J, 3, N), each in its own local frame.

    Torso frames have x to the body's left along the shoulder or hip line, y up the spine, z to
    the front. The frame of a bone further out is its parent's, turned so that the parent points
    along its own reference direction.
    """

    def __init__(self, poses: FloatArray, skeleton: str, references: dict[str, FloatArray]) -> None:
        self._known = skeletons.get(skeleton)
        self._poses = poses
        self._references = references
        self._axes: dict[tuple[str, str], FloatArray] = {}
        self.local: dict[str, FloatArray] = {}

    def _torso_axes(self, line: tuple[str, str]) -> FloatArray:
        """(3, 3, N): row i is axis i in the world."""
        if line not in self._axes:
            left, right = (self._poses[self._known.index(joint)] for joint in line)
            x = _unit(left - right)
            spine = self._poses[1] - self._poses[0]
            z = _unit(np.cross(x, spine, axis=0))
            self._axes[line] = np.stack([x, np.cross(z, x, axis=0), z])
        return self._axes[line]

    def world_direction(self, bone: str) -> FloatArray:
        """Unit vector (3, N) along the bone in the world, NaN where it is unknown."""
        child = self._known.index(bone)
        return _unit(self._poses[child] - self._poses[self._known.parents[child]])

    def local_direction(self, bone: str) -> FloatArray:
        """Local direction (3, N) of a bone, remembered in `local` for the bones further out."""
        line, chain = _LIMITED[bone]
        axes, world = self._torso_axes(line), self.world_direction(bone)
        direction: FloatArray = (axes * world[None]).sum(axis=1)
        for ancestor in chain:
            reference = self._references[ancestor][:, None]
            direction = transport(self.local[ancestor], reference, direction)
        self.local[bone] = direction
        return direction

    def to_world(self, bone: str, local: FloatArray) -> FloatArray:
        """The inverse of `local_direction` for any local direction (3, N) of the bone."""
        line, chain = _LIMITED[bone]
        direction = local
        for ancestor in reversed(chain):
            reference = np.broadcast_to(
                self._references[ancestor][:, None], self.local[ancestor].shape
            )
            direction = transport(reference, self.local[ancestor], direction)
        axes = self._torso_axes(line)
        world: FloatArray = (axes * direction[:, None]).sum(axis=0)
        return world


def _unit(vector: FloatArray) -> FloatArray:
    """Vectors (3, ...) scaled to length one; NaN where the length is zero."""
    norm = np.sqrt((vector * vector).sum(axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: FloatArray = vector / norm
    return unit
