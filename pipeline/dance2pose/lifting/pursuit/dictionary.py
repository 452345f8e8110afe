"""Pose dictionaries: a mean pose and many atoms, of which a pose needs only a few.

A pose is mean + sum of w_i atom_i (Ramakrishna, Kanade, Sheikh, ECCV 2012, eq. 1). Poses stand in
body axes (`alignment`): x to the body's left, y up the spine, z to the front, mm on the one body
of `mocap.corpus`, first joint at the origin.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.assets import asset
from dance2pose.errors import DataError, UsageError
from dance2pose.npz_files import read_arrays, write_arrays
from dance2pose.poses import FloatArray

# A dictionary is some hundred kilobytes; an archive that claims much more is not one.
_MAX_BYTES = 100_000_000


@dataclass(frozen=True)
class Dictionary:
    """A learned dictionary of one lifting skeleton with J joints.

    atoms: (K, J, 3), each of unit norm over all its coordinates, first joint zero. mean: (J, 3) mm.
    bone_lengths: (J - 1,) mm, equal for all poses. metadata: sources, licence, how it was learned.
    """

    skeleton: str
    atoms: FloatArray
    mean: FloatArray
    bone_lengths: FloatArray
    metadata: dict[str, Any]

    def __len__(self) -> int:
        return len(self.atoms)

    @property
    def joints(self) -> int:
        return len(self.mean)

    @cached_property
    def sum_of_squared_lengths(self) -> float:
        """What R12's anthropometric constraint holds constant, mm^2."""
        return float((self.bone_lengths**2).sum())

    @cached_property
    def flat_atoms(self) -> npt.NDArray[np.float64]:
        """(K, 3 J)"""
        return np.ascontiguousarray(self.atoms.reshape(len(self), -1), dtype=np.float64)

    @cached_property
    def flat_atoms32(self) -> npt.NDArray[np.float32]:
        """(K, 3 J) in single precision"""
        return self.flat_atoms.astype(np.float32)

    @cached_property
    def spread(self) -> npt.NDArray[np.float32]:
        """Covariances (9, K) of the atoms over joints: with S = R2^T R2, R2 the rows of a rotation
        that are seen, S.ravel() @ spread is an atom's squared norm in the image."""
        centred = self.atoms - self.atoms.mean(axis=1, keepdims=True)
        covariance = np.swapaxes(centred, 1, 2) @ centred
        return np.ascontiguousarray(covariance.reshape(len(self), 9).T, dtype=np.float32)

    @cached_property
    def atom_bones(self) -> npt.NDArray[np.float64]:
        """Bone vectors (K, 3 (J - 1)) of the atoms: child less parent."""
        return np.ascontiguousarray(self.bones_of(self.atoms), dtype=np.float64)

    @cached_property
    def mean_bones(self) -> FloatArray:
        """Bone vectors (3 (J - 1),) of the mean pose, mm."""
        bones: FloatArray = self.bones_of(self.mean[None])[0]
        return bones

    def bones_of(self, xyz: FloatArray) -> FloatArray:
        """Bone vectors (N, 3 (J - 1)) of poses (N, J, 3)."""
        parents, children = np.array(skeletons.get(self.skeleton).bones).T
        bones: FloatArray = xyz[:, children] - xyz[:, parents]
        return bones.reshape(len(xyz), 3 * (self.joints - 1))

    def pose(self, active: npt.NDArray[np.int64], coefficients: FloatArray) -> FloatArray:
        """Poses (N, J, 3) mm in body axes of active atoms (N, k) and coefficients (N, k)."""
        atoms = self.flat_atoms[active]
        flat: FloatArray = self.mean.reshape(-1) + (coefficients[:, None] @ atoms)[:, 0]
        return flat.reshape(-1, self.joints, 3)


@lru_cache
def load(skeleton: str) -> Dictionary:
    """The dictionary that comes with dance2pose for a lifting skeleton, read once."""
    known = skeletons.get(skeleton)
    if not known.is_tree:
        raise UsageError(
            f"no dictionary for {skeleton}, which is a set of keypoints; convert them to body17"
        )
    return read(asset(f"dictionary_{known.name}.npz"))


def save(dictionary: Dictionary, path: Path, *, overwrite: bool = False) -> None:
    """Write a dictionary as one .npz, float32; the same dictionary gives the same bytes."""
    arrays = {
        "skeleton": np.array(dictionary.skeleton),
        "joints": np.array(skeletons.get(dictionary.skeleton).joints),
        "atoms": dictionary.atoms.astype(np.float32),
        "mean": dictionary.mean.astype(np.float32),
        "bone_lengths": dictionary.bone_lengths.astype(np.float32),
        "sum_of_squared_lengths": np.array(dictionary.sum_of_squared_lengths),
        "metadata": np.array(json.dumps(dictionary.metadata, indent=1, sort_keys=True)),
    }
    write_arrays(path, arrays, overwrite=overwrite)


def read(path: Path) -> Dictionary:
    """A dictionary from a .npz. Raises DataError where it is not one or its arrays do not fit."""
    values = read_arrays(path, max_bytes=_MAX_BYTES)
    try:
        skeleton = str(values["skeleton"])
        known = skeletons.get(skeleton)
        atoms, mean, lengths = (
            values[name].astype(np.float64) for name in ("atoms", "mean", "bone_lengths")
        )
        metadata = json.loads(str(values["metadata"]))
    except KeyError as error:
        raise DataError(f"{path}: lacks {error}; expected a file of train_dictionary.py") from None
    except (ValueError, UsageError) as error:
        raise DataError(f"{path}: cannot be read as a dictionary: {error}") from error
    joints = len(known)
    wanted = {"atoms": (len(atoms), joints, 3), "mean": (joints, 3), "bone_lengths": (joints - 1,)}
    for name, array in (("atoms", atoms), ("mean", mean), ("bone_lengths", lengths)):
        if array.shape != wanted[name] or not np.isfinite(array).all():
            raise DataError(
                f"{path}: {name} has shape {array.shape}, expected finite {wanted[name]}"
            )
    if len(atoms) == 0:
        raise DataError(f"{path}: holds no atoms")
    norms = np.linalg.norm(atoms, axis=(1, 2), keepdims=True)
    if (norms < 1e-6).any():
        raise DataError(f"{path}: holds an atom without length")
    atoms /= norms  # float32 in the file leaves them a little off one
    return Dictionary(skeleton, atoms, mean, lengths, metadata)
