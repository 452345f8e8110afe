"""Pose-conditioned joint-angle limits: which bones of a pose a human body can hold.

The form is that of Akhter & Black (CVPR 2015), section 3. A bone that leaves the torso is valid
where its direction, seen from the shoulders or the hips, falls in an occupied bin of 3 degrees. A
bone further out is seen from its parent bone; the bin of the parent selects a half-space and a
box, and the direction must lie in both. The arrays are learned (`limits.learning`), never theirs.

Bones are named by the joint they end at; in (..., J - 1) flags bone b ends at joint b + 1.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.assets import asset
from dance2pose.errors import DataError, UsageError
from dance2pose.limits.body_frames import (
    AZIMUTHS,
    ELEVATIONS,
    BodyFrames,
    bins,
    limited_bones,
    parent_bone,
)
from dance2pose.output_files import written_whole
from dance2pose.poses import BoolArray, FloatArray, IntArray

_CHUNK = 8192  # poses looked at together: the working set stays in the processor's cache


# Limits that fewer takes than this came near are no limits, only the end of what was seen.
FEWEST_TAKES = 8


@dataclass(frozen=True)
class Verdict:
    """valid: (..., J - 1) False where a bone is outside its limits. takes: (..., J - 1) how many
    takes, 255 at most, tell where those limits lie; 0 for bones without limits."""

    valid: BoolArray
    takes: npt.NDArray[np.uint8]

    @property
    def refused(self) -> BoolArray:
        """(..., J - 1) True where many takes went as far as the limit and none beyond."""
        return np.asarray(~self.valid & (self.takes >= FEWEST_TAKES))


@dataclass(frozen=True)
class Limits:
    """Learned limits of one lifting skeleton.

    bones: the B limited bones, those of the torso first. references: (B, 3) typical direction of
    each in its frame. occupancy: (B_torso, 120, 60) True where a direction was seen, widened by
    the margin. region: (B - B_torso, 120, 60) row of the regions for each bin of the parent.
    axes, low, high: (R, 3, 3), (R, 3), (R, 3); a direction d is valid where
    low <= axes @ d <= high. The first axis is the normal of the half-space, the others span the
    box. takes: (B, 120, 60) how many takes, 255 at most, tell where the limit of each bone lies,
    for the bins of the bone itself or of its parent. metadata: where the arrays come from.
    """

    skeleton: str
    bones: tuple[str, ...]
    references: FloatArray
    occupancy: BoolArray
    region: npt.NDArray[np.int32]
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    takes: npt.NDArray[np.uint8]
    metadata: dict[str, Any]

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., J - 1) of the bones of poses (..., J, 3), any unit, any rotation.

        Bones without limits are True. A bone is also True where it or the frame it is seen from
        is unknown (NaN, or of length zero): True means "not refused", not "seen and possible".
        """
        return self.verdict(xyz).valid

    def verdict(self, xyz: FloatArray) -> Verdict:
        """What the limits say of poses (..., J, 3), and how many takes say it; see `is_valid`."""
        flat = self.flat(xyz)
        flags = np.ones((len(flat), flat.shape[1] - 1), dtype=bool)
        takes = np.zeros(flags.shape, dtype=np.uint8)
        columns = self.columns
        for start in range(0, len(flat), _CHUNK):
            part = slice(start, start + _CHUNK)
            frames = self.frames(flat[part])
            for number, bone in enumerate(self.bones):
                direction = frames.local_direction(bone)
                flags[part, columns[number]] = self.allowed(bone, frames, direction)
                deciding = frames.local[parent_bone(bone) or bone]
                takes[part, columns[number]] = self.takes[(number, *bins(deciding))]
        shape = (*xyz.shape[:-2], flags.shape[1])
        return Verdict(flags.reshape(shape), takes.reshape(shape))

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

    @property
    def columns(self) -> IntArray:
        """The column of each limited bone in the flags."""
        known = skeletons.get(self.skeleton)
        return np.array([known.index(bone) - 1 for bone in self.bones])

    def flat(self, xyz: FloatArray) -> FloatArray:
        """Poses (..., J, 3) as (N, J, 3); UsageError where they are not of this skeleton."""
        joints = len(skeletons.get(self.skeleton))
        if xyz.ndim < 2 or xyz.shape[-2:] != (joints, 3):
            raise UsageError(
                f"poses of shape {xyz.shape}; the limits of {self.skeleton} need (..., {joints}, 3)"
            )
        return xyz.reshape(-1, joints, 3)


_ARRAYS = ("references", "occupancy", "region", "axes", "low", "high", "takes")


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
        "takes": (len(wanted), *grid),
    }
    if limits.bones != wanted:
        raise DataError(f"{path}: limits of the bones {limits.bones}, expected {wanted}")
    for name, shape in shapes.items():
        if getattr(limits, name).shape != shape:
            found = getattr(limits, name).shape
            raise DataError(f"{path}: {name} has shape {found}, expected {shape}")
    if limits.region.size and not 0 <= limits.region.min() <= limits.region.max() < rows:
        raise DataError(f"{path}: region points outside the {rows} regions")
