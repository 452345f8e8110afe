"""The joint-angle limits that Akhter & Black published (CVPR 2015), from their own files.

No licence is stated for those files, so dance2pose brings none of them: whoever holds
`jointAngleModel.mat` or `jointAngleModel_v2.mat`, and `staticPose.mat`, loads them here. The
flags are those of the authors' own code, for any number of poses at once.

Their joints are cmu17's in the same order. Their torso frame has x to the body's right, y up the
spine and z to the front; it and the frames built from it are left-handed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from dance2pose.errors import DataError, UsageError
from dance2pose.poses import BoolArray, FloatArray, IntArray
from dance2pose.skeleton import get

_SKELETON = "cmu17"
_BIN_DEGREES = 3
_GRID = (121, 61)  # bins of azimuth and elevation
# Bones (by the joint they end at) that leave the torso, and the line that carries each frame.
_TORSO_CHILDREN = {
    "left_elbow": ("left_shoulder", "right_shoulder"),
    "right_elbow": ("left_shoulder", "right_shoulder"),
    "head": ("left_shoulder", "right_shoulder"),
    "left_knee": ("left_hip", "right_hip"),
    "right_knee": ("left_hip", "right_hip"),
}


@dataclass(frozen=True)
class _Bone:
    """One limited bone: the bone that it is seen from, and the arrays that limit it.

    occupancy: (121, 61), or None where plane (121, 61, 4), second (121, 61, 3) and bounds
    (121, 61, 4) limit it, per bin of the parent.
    """

    joint: str
    parent: str
    occupancy: BoolArray | None
    plane: FloatArray
    second: FloatArray
    bounds: FloatArray


@dataclass(frozen=True)
class AuthorsLimits:
    """The published limits. bones: inner before outer. forward: the vector `a` of their files,
    from which the second axis of every frame beyond the torso is made."""

    bones: tuple[_Bone, ...]
    forward: FloatArray
    skeleton: str = _SKELETON

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., 16) of cmu17 poses (..., 17, 3), any unit, any rotation.

        Torso bones are always True, and so are bones that are unknown (NaN). A bone whose parent
        points where the model knows nothing is False, as in the authors' code.
        """
        skeleton = get(_SKELETON)
        if xyz.ndim < 2 or xyz.shape[-2:] != (len(skeleton), 3):
            raise UsageError(f"poses of shape {xyz.shape}; expected (..., {len(skeleton)}, 3)")
        poses = np.asarray(xyz, dtype=np.float64).reshape(-1, len(skeleton), 3)
        flags = np.ones((len(poses), len(skeleton) - 1), dtype=bool)
        frames: dict[str, FloatArray] = {}
        local: dict[str, FloatArray] = {}
        with np.errstate(invalid="ignore", divide="ignore"):
            for bone in self.bones:
                joint = skeleton.index(bone.joint)
                world = _unit(poses[:, joint] - poses[:, skeleton.parents[joint]])
                if bone.occupancy is not None:
                    frame = _torso_frame(poses, _TORSO_CHILDREN[bone.joint])
                else:
                    frame = frames[bone.parent]
                direction = np.einsum("nij,nj->ni", frame, world)
                local[bone.joint] = direction
                frames[bone.joint] = self._outer_frame(frame, world)
                if bone.occupancy is not None:
                    allowed: BoolArray = bone.occupancy[_bins(direction)]
                else:
                    allowed = _in_region(bone, _bins(local[bone.parent]), direction)
                flags[:, joint - 1] = allowed | np.isnan(direction).any(axis=1)
        shaped: BoolArray = flags.reshape(*xyz.shape[:-2], len(skeleton) - 1)
        return shaped

    def _outer_frame(self, frame: FloatArray, bone: FloatArray) -> FloatArray:
        """The frame (N, 3, 3) of what hangs on a bone: along it, and away from `forward`."""
        forward = np.einsum("nij,i->nj", frame, self.forward)
        across = _unit(forward - (forward * bone).sum(axis=1, keepdims=True) * bone)
        axes: FloatArray = np.stack([bone, np.cross(bone, across), across], axis=1)
        return axes


def _unit(vectors: FloatArray) -> FloatArray:
    unit: FloatArray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def _torso_frame(poses: FloatArray, line: tuple[str, str]) -> FloatArray:
    """Rows right, up, front (N, 3, 3) from the shoulder or hip line and the spine."""
    skeleton = get(_SKELETON)
    left, right = (poses[:, skeleton.index(joint)] for joint in line)
    x = _unit(right - left)
    spine = poses[:, 1] - poses[:, 0]
    y = _unit(spine - (spine * x).sum(axis=1, keepdims=True) * x)
    axes: FloatArray = np.stack([x, y, np.cross(y, x)], axis=1)
    return axes


def _bins(direction: FloatArray) -> tuple[IntArray, IntArray]:
    x, y, z = np.nan_to_num(direction).T
    azimuth = np.degrees(np.arctan2(y, x)) + 180
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y))) + 90
    return (azimuth // _BIN_DEGREES).astype(np.int64), (elevation // _BIN_DEGREES).astype(np.int64)


def _in_region(bone: _Bone, parent_bins: tuple[IntArray, IntArray], child: FloatArray) -> BoolArray:
    """Half-space and box; where the parent's bin has none (NaN) every comparison is False."""
    plane, bounds = bone.plane[parent_bins], bone.bounds[parent_bins]
    normal = plane[:, :3]
    second = bone.second[parent_bins]
    second = _unit(second - (second * normal).sum(axis=1, keepdims=True) * normal)
    u = (second * child).sum(axis=1)
    v = (np.cross(normal, second) * child).sum(axis=1)
    inside: BoolArray = (normal * child).sum(axis=1) + plane[:, 3] <= 0
    inside &= (bounds[:, 0] <= u) & (u <= bounds[:, 1])
    inside &= (bounds[:, 2] <= v) & (v <= bounds[:, 3])
    return inside


def read_authors_limits(model: Path, static_pose: Path) -> AuthorsLimits:
    """Limits from the authors' model file and `staticPose.mat`; DataError where they are not."""
    arrays = _read_mat(model, ("angleSprd", "sepPlane", "E2", "bounds", "chlds", "prnts", "jmp"))
    forward = _read_mat(static_pose, ("a",))["a"].ravel().astype(np.float64)
    if forward.shape != (3,) or not np.isfinite(forward).all():
        raise DataError(f"{static_pose}: `a` is not a vector of three numbers")
    if arrays["jmp"].ravel().tolist() != [_BIN_DEGREES]:
        raise DataError(f"{model}: bins of {arrays['jmp'].ravel()} degrees, expected 3")
    joints = get(_SKELETON).joints
    children, parents = (arrays[name].ravel().astype(int) for name in ("chlds", "prnts"))
    bones = []
    for number, (child, parent) in enumerate(zip(children, parents, strict=True)):
        if not (0 < child < len(joints) and 0 < parent < len(joints)):
            raise DataError(f"{model}: `chlds` or `prnts` names a bone that is not one of 1..16")
        on_torso = joints[child] in _TORSO_CHILDREN
        bones.append(
            _Bone(
                joints[child],
                joints[parent],
                _cell(model, arrays, "angleSprd", number, _GRID) > 0 if on_torso else None,
                *(
                    np.empty((0,)) if on_torso else _cell(model, arrays, name, number, shape)
                    for name, shape in (
                        ("sepPlane", (*_GRID, 4)),
                        ("E2", (*_GRID, 3)),
                        ("bounds", (*_GRID, 4)),
                    )
                ),
            )
        )
    return AuthorsLimits(tuple(bones), forward)


def _read_mat(path: Path, names: tuple[str, ...]) -> dict[str, npt.NDArray[Any]]:
    try:
        values: dict[str, npt.NDArray[Any]] = loadmat(path, variable_names=names)
    except (OSError, ValueError, TypeError, NotImplementedError, MatReadError) as error:
        raise DataError(f"{path}: cannot be read as a MATLAB file: {error}") from error
    missing = [name for name in names if name not in values]
    if missing:
        raise DataError(f"{path}: lacks {', '.join(missing)}; expected the authors' limits")
    return values


def _cell(
    path: Path,
    arrays: dict[str, npt.NDArray[Any]],
    name: str,
    number: int,
    shape: tuple[int, ...],
) -> FloatArray:
    cells = arrays[name].ravel()
    cell = np.asarray(cells[number]) if number < len(cells) else np.empty(0)
    if cell.shape != shape or cell.dtype.kind not in "fiu":
        raise DataError(f"{path}: {name}{{{number + 1}}} is {cell.shape}, expected {shape}")
    values: FloatArray = cell.astype(np.float64)
    return values
