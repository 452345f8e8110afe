"""How well joint-angle limits tell possible bones from impossible ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.limits.body_frames import limited_bones
from dance2pose.poses import BoolArray, FloatArray

# A bone that is turned at random is turned by more than this.
TURNED_DEGREES = 60.0


class JointLimits(Protocol):
    """Learned limits, or the published ones."""

    @property
    def skeleton(self) -> str:
        """The lifting skeleton they are for."""
        ...

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., J - 1) of poses (..., J, 3)."""
        ...


@dataclass(frozen=True)
class LimitsScore:
    """Of each limited bone: the share of real ones valid, of turned ones refused (B,)."""

    bones: tuple[str, ...]
    valid: FloatArray
    refused: FloatArray


def score(limits: JointLimits, poses: FloatArray, rng: np.random.Generator) -> LimitsScore:
    """Limits on real poses (N, J, 3), and on the same with one bone at a time turned at random."""
    tree = skeletons.get(limits.skeleton)
    bones = limited_bones(limits.skeleton)
    columns = [tree.index(bone) - 1 for bone in bones]
    valid = limits.is_valid(poses)[:, columns].mean(axis=0)
    refused = [
        1.0 - limits.is_valid(turned(poses, bone, limits.skeleton, rng))[:, column].mean()
        for bone, column in zip(bones, columns, strict=True)
    ]
    return LimitsScore(bones, valid, np.array(refused))


def turned(poses: FloatArray, bone: str, skeleton: str, rng: np.random.Generator) -> FloatArray:
    """Poses (N, J, 3) in which one bone points anywhere on the sphere but near where it did.

    The direction is uniform over all that are more than TURNED_DEGREES away. What hangs on the
    bone moves along without turning.
    """
    tree = skeletons.get(skeleton)
    child = tree.index(bone)
    start = poses[:, tree.parents[child]]
    old = poses[:, child] - start
    length = np.linalg.norm(old, axis=1, keepdims=True)
    unit = old / length
    # The cosine of the angle to the old direction is uniform on a sphere.
    cosine = rng.uniform(-1.0, np.cos(np.radians(TURNED_DEGREES)), (len(poses), 1))
    across = rng.standard_normal(unit.shape)
    across -= (across * unit).sum(axis=1, keepdims=True) * unit
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    new = length * (cosine * unit + np.sqrt(1 - cosine**2) * across)
    out = poses.copy()
    for joint in _from(tree.parents, child):
        out[:, joint] += new - old
    return out


def _from(parents: Sequence[int], first: int) -> list[int]:
    """The joint and all that hang on it."""
    moved = [first]
    for joint in range(first + 1, len(parents)):
        if parents[joint] in moved:
            moved.append(joint)
    return moved
