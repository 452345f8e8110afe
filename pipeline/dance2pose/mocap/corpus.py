"""Takes of motion capture as `cmu17` joints on one body: what learning and evaluation start from.

Retargeting keeps every bone's direction and sets its length (METHOD: equal bone lengths for all
subjects), so that shape is not confused with stature.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose.errors import DataError
from dance2pose.mocap.bvh import read_bvh
from dance2pose.mocap.motion import Motion, forward_kinematics
from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton, get

# The nodes of the two BVH rigs, in the order of cmu17.
_CMU_RIG = (
    "Hips Spine1 LeftArm LeftForeArm LeftHand RightArm RightForeArm RightHand Head LeftUpLeg "
    "LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase"
).split()
_POSER_RIG = (
    "hip chest lShldr lForeArm lHand rShldr rForeArm rHand neck lThigh lShin lFoot lFoot_end "
    "rThigh rShin rFoot rFoot_end"
).split()

# Bone lengths of the one body, mm, in the order of cmu17's bones: the body that the CMU actions
# corpus is given on, its left and right sides made equal.
BODY_BONES_MM: FloatArray = np.array(
    [232.7, *(204.7, 279.1, 189.7) * 2, 175.0, *(141.7, 428.4, 409.3, 125.8) * 2]
)
# From sole to crown when that body stands: its ankles are 0.94 m below the root, the soles about
# 0.08 m lower; the base of the skull is 0.41 m above it, the crown about 0.22 m higher.
BODY_HEIGHT_MM = 1650.0


@dataclass(frozen=True)
class Take:
    """One take on the one body.

    xyz: (T, 17, 3) mm, y up, root at the origin. root: (T, 3) mm, its path before that, or None
    where the source has none. rate_hz: frames per second.
    """

    name: str
    xyz: FloatArray
    root: FloatArray | None
    rate_hz: float


def cmu17_positions(motion: Motion, source: str = "motion") -> FloatArray:
    """Positions (T, 17, 3) of the cmu17 joints of either rig, in the file's unit."""
    for rig in (_CMU_RIG, _POSER_RIG):
        if all(node in motion.names for node in rig):
            columns = [motion.names.index(node) for node in rig]
            return forward_kinematics(motion)[0][:, columns]
    raise DataError(
        f"{source}: its joints are of neither known rig; expected {_CMU_RIG} or {_POSER_RIG}"
    )


def retarget(xyz: FloatArray, skeleton: Skeleton, lengths: FloatArray) -> FloatArray:
    """The same bone directions with other bone lengths, root at the origin.

    xyz: (..., J, 3); lengths: (J - 1,). A bone of length zero stays of length zero.
    """
    out = np.zeros_like(xyz)
    for (parent, child), length in zip(skeleton.bones, lengths, strict=True):
        bone = xyz[..., child, :] - xyz[..., parent, :]
        norm = np.linalg.norm(bone, axis=-1, keepdims=True)
        direction = np.divide(bone, norm, out=np.zeros_like(bone), where=norm > 0)
        out[..., child, :] = out[..., parent, :] + length * direction
    return out


def read_take(path: Path) -> Take:
    """A BVH take on the one body, with the corpus's traps undone (rest pose, rates, units)."""
    motion = read_bvh(path)
    xyz = cmu17_positions(motion, str(path))
    numbered = "Hips" in motion.names
    rate = 60.0 if "_salsa_" in path.stem else 1 / motion.frame_time_s
    if numbered:  # the first frame of these files is an inserted rest pose
        xyz = xyz[1:]
    skeleton = get("cmu17")
    lengths = bone_lengths(xyz, skeleton)
    to_mm = BODY_BONES_MM.sum() / lengths.sum()
    body = retarget(xyz, skeleton, BODY_BONES_MM)
    return Take(path.stem, body, xyz[:, 0] * to_mm, round(rate, 3))


def bone_lengths(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    """Median length (J - 1,) of each bone over frames (T, J, 3)."""
    parents, children = np.array(skeleton.bones).T
    lengths: FloatArray = np.nanmedian(
        np.linalg.norm(xyz[:, children] - xyz[:, parents], axis=-1), axis=0
    )
    return lengths


def read_takes(folder: Path) -> Iterator[Take]:
    """Every .bvh of a folder, and every take of a .npz of joint positions, in name order."""
    files = sorted(p for p in folder.iterdir() if p.suffix in (".bvh", ".npz"))
    if not files:
        raise DataError(f"{folder}: holds no .bvh and no .npz")
    for path in files:
        if path.suffix == ".bvh":
            yield read_take(path)
        else:
            with np.load(path, allow_pickle=False) as archive:
                for name in archive.files:
                    yield Take(name, archive[name].astype(float), None, 120.0)
