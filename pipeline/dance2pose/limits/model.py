"""Pose-conditioned joint-angle limits: which bones of a pose a human body can hold.

The form is that of Akhter & Black (CVPR 2015), section 3. A bone that leaves the torso is valid
where its direction, seen from the shoulders or the hips, falls in an occupied bin of 3 degrees. A
bone further out is seen from its parent bone; the bin of the parent selects a half-space and a
box, and the direction must lie in both. The arrays are learned (`limits_learning`), never theirs.

Bones are named by the joint they end at; in (..., J - 1) flags bone b ends at joint b + 1.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.assets import asset
from dance2pose.errors import DataError, UsageError
from dance2pose.output_files import written_whole
from dance2pose.poses import BoolArray, FloatArray, IntArray

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
_CHUNK = 8192  # poses looked at together: the working set stays in the processor's cache


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

    def look(self, bone: str) -> FloatArray:
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
        """The inverse of `look` for any local direction (3, N) of the bone."""
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


@dataclass(frozen=True)
class Limits:
    """Learned limits of one lifting skeleton.

    bones: the B limited bones, those of the torso first. references: (B, 3) typical direction of
    each in its frame. occupancy: (B_torso, 120, 60) True where a direction was seen, widened by
    the margin. region: (B - B_torso, 120, 60) row of the regions for each bin of the parent.
    axes, low, high: (R, 3, 3), (R, 3), (R, 3); a direction d is valid where
    low <= axes @ d <= high. The first axis is the normal of the half-space, the others span the
    box. metadata: where the arrays come from.
    """

    skeleton: str
    bones: tuple[str, ...]
    references: FloatArray
    occupancy: BoolArray
    region: npt.NDArray[np.int32]
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    metadata: dict[str, Any]

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., J - 1) of the bones of poses (..., J, 3), any unit, any rotation.

        Bones without limits are True. A bone is also True where it or the frame it is seen from
        is unknown (NaN, or of length zero): True means "not refused", not "seen and possible".
        """
        flat = self._flat(xyz)
        flags = np.ones((len(flat), flat.shape[1] - 1), dtype=bool)
        columns = self.columns
        for start in range(0, len(flat), _CHUNK):
            part = slice(start, start + _CHUNK)
            frames = self.frames(flat[part])
            for number, bone in enumerate(self.bones):
                direction = frames.look(bone)
                flags[part, columns[number]] = self.allowed(bone, frames, direction)
        shaped: BoolArray = flags.reshape(*xyz.shape[:-2], flags.shape[1])
        return shaped

    def allowed(self, bone: str, frames: BodyFrames, direction: FloatArray) -> BoolArray:
        """Whether local directions (3, N) of one bone are valid given the bones further in."""
        number = self.bones.index(bone)
        parent = parent_bone(bone)
        if parent is None:
            occupied: BoolArray = self.occupancy[(number, *bins(direction))]
            return np.asarray(occupied | np.isnan(direction[0]))
        rows = self.region_rows(bone, frames)
        inside = np.ones(direction.shape[1], dtype=bool)
        for axis in range(3):
            along = np.einsum("ni,in->n", self.axes[rows, axis], direction)
            inside &= ~((along < self.low[rows, axis]) | (along > self.high[rows, axis]))
        return inside

    def region_rows(self, bone: str, frames: BodyFrames) -> npt.NDArray[np.int32]:
        """The rows of the regions that the parent's directions in `frames` select."""
        parent = parent_bone(bone)
        assert parent is not None
        number = self.bones.index(bone) - len(self.occupancy)
        rows: npt.NDArray[np.int32] = self.region[(number, *bins(frames.local[parent]))]
        return rows

    def frames(self, poses: FloatArray) -> BodyFrames:
        """The local frames of poses (N, J, 3)."""
        references = dict(zip(self.bones, self.references, strict=True))
        return BodyFrames(np.ascontiguousarray(poses.transpose(1, 2, 0)), self.skeleton, references)

    def project_to_valid(self, xyz: FloatArray) -> FloatArray:
        """The closest valid poses (..., J, 3), bone lengths kept.

        From the torso outwards, each refused bone takes the valid direction closest to its own;
        bones that are valid, and the torso, keep theirs. Unknown bones stay as they are.
        """
        from dance2pose.limits.projection import project

        return project(self, self._flat(xyz)).reshape(xyz.shape)

    @property
    def columns(self) -> IntArray:
        """The column of each limited bone in the flags."""
        known = skeletons.get(self.skeleton)
        return np.array([known.index(bone) - 1 for bone in self.bones])

    def _flat(self, xyz: FloatArray) -> FloatArray:
        joints = len(skeletons.get(self.skeleton))
        if xyz.ndim < 2 or xyz.shape[-2:] != (joints, 3):
            raise UsageError(
                f"poses of shape {xyz.shape}; the limits of {self.skeleton} need (..., {joints}, 3)"
            )
        return xyz.reshape(-1, joints, 3)


_ARRAYS = ("references", "occupancy", "region", "axes", "low", "high")


def save(limits: Limits, path: Path, *, overwrite: bool = False) -> None:
    """Write the limits as one .npz."""
    arrays = {name: getattr(limits, name) for name in _ARRAYS}
    with written_whole(path, overwrite=overwrite) as temporary:
        np.savez_compressed(
            temporary,
            allow_pickle=False,
            skeleton=np.array(limits.skeleton),
            bones=np.array(limits.bones),
            metadata=np.array(json.dumps(limits.metadata, indent=1)),
            **arrays,
        )


@lru_cache
def load(skeleton: str) -> Limits:
    """The limits that come with dance2pose for a lifting skeleton, read once."""
    return read(asset(f"limits_{skeletons.get(skeleton).name}.npz"))


def read(path: Path) -> Limits:
    """Limits from a .npz. Raises DataError where it is not one or its arrays do not fit."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            values = {name: archive[name] for name in archive.files}
        limits = Limits(
            str(values["skeleton"]),
            tuple(values["bones"].tolist()),
            **{name: values[name] for name in _ARRAYS},
            metadata=json.loads(str(values["metadata"])),
        )
    except KeyError as error:
        raise DataError(f"{path}: lacks {error}; expected limits made by learn_limits.py") from None
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as limits: {error}") from error
    _check(limits, path)
    return limits


def _check(limits: Limits, path: Path) -> None:
    wanted = limited_bones(limits.skeleton)
    torso = sum(parent_bone(bone) is None for bone in wanted)
    grid = (AZIMUTHS, ELEVATIONS)
    rows = len(limits.axes)
    shapes = {
        "references": (len(wanted), 3),
        "occupancy": (torso, *grid),
        "region": (len(wanted) - torso, *grid),
        "axes": (rows, 3, 3),
        "low": (rows, 3),
        "high": (rows, 3),
    }
    if limits.bones != wanted:
        raise DataError(f"{path}: limits of the bones {limits.bones}, expected {wanted}")
    for name, shape in shapes.items():
        if getattr(limits, name).shape != shape:
            found = getattr(limits, name).shape
            raise DataError(f"{path}: {name} has shape {found}, expected {shape}")
    if limits.region.size and not 0 <= limits.region.min() <= limits.region.max() < rows:
        raise DataError(f"{path}: region points outside the {rows} regions")


def without_limits(limits: Limits) -> Limits:
    """The same bones with every direction allowed (ablation)."""
    return replace(
        limits,
        occupancy=np.ones_like(limits.occupancy),
        low=np.full_like(limits.low, -2),
        high=np.full_like(limits.high, 2),
    )
