"""The figure's bones, and how motion capture of either rig turns them.

The figure rests with its arms hanging at 45 degrees, looking along +z. A pose is one rotation
world-from-rest a bone, and where the pelvis is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dance2pose.mocap.bvh import read_bvh
from dance2pose.mocap.motion import forward_kinematics

Array = npt.NDArray[np.float64]

# Bone: (parent, node of the numbered CMU rig, node of the other rig).
_BONES = {
    "pelvis": ("", "Hips", "hip"),
    "spine": ("pelvis", "LowerBack", "abdomen"),
    "chest": ("spine", "Spine1", "chest"),
    "neck": ("chest", "Neck1", "neck"),
    "head": ("neck", "Head", "head"),
}
for _side, _long, _short in (("left", "Left", "l"), ("right", "Right", "r")):
    _BONES |= {
        f"{_side}_collar": ("chest", f"{_long}Shoulder", f"{_short}Collar"),
        f"{_side}_upper_arm": (f"{_side}_collar", f"{_long}Arm", f"{_short}Shldr"),
        f"{_side}_forearm": (f"{_side}_upper_arm", f"{_long}ForeArm", f"{_short}ForeArm"),
        f"{_side}_hand": (f"{_side}_forearm", f"{_long}Hand", f"{_short}Hand"),
        f"{_side}_thigh": ("pelvis", f"{_long}UpLeg", f"{_short}Thigh"),
        f"{_side}_shin": (f"{_side}_thigh", f"{_long}Leg", f"{_short}Shin"),
        f"{_side}_foot": (f"{_side}_shin", f"{_long}Foot", f"{_short}Foot"),
    }
BONES = tuple(_BONES)
PARENTS = tuple(BONES.index(parent) if parent else -1 for parent, _, _ in _BONES.values())

# Bones whose rest direction differs between the rigs and the figure: the child that shows it.
_SHOWN_BY = {
    "upper_arm": ("ForeArm", "ForeArm"),
    "forearm": ("Hand", "Hand"),
    "hand": ("HandIndex1", "Mid1"),
    "thigh": ("Leg", "Shin"),
    "shin": ("Foot", "Foot"),
}


def rest_direction(bone: str) -> Array:
    """Unit vector along a limb bone of the resting figure."""
    if bone.endswith(("thigh", "shin")):
        return np.array([0.0, -1.0, 0.0])
    side = 1.0 if bone.startswith("left") else -1.0
    return np.array([side, -1.0, 0.0]) / np.sqrt(2)


def turn_between(a: Array, b: Array) -> Array:
    """The smallest rotation that takes direction a to direction b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cross, cosine = np.cross(a, b), float(a @ b)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1 + cosine)


@dataclass(frozen=True)
class Performance:
    """A take as the figure dances it.

    rotation: (T, B, 3, 3) world-from-rest. pelvis: (T, 3), in leg lengths of the performer.
    """

    name: str
    rotation: Array
    pelvis: Array
    rate_hz: float

    def __len__(self) -> int:
        return len(self.rotation)


def read_performance(path: Path, *, every: int = 1) -> Performance:
    """Read a BVH take of either rig, every so many frames."""
    motion = read_bvh(path)
    numbered = "Hips" in motion.names
    column = 1 if numbered else 2
    nodes = [motion.names.index(words[column]) for words in _BONES.values()]
    _, world = forward_kinematics(motion)
    rotation = world[:, nodes].copy()
    for bone, name in enumerate(BONES):
        kind = name.split("_", 1)[-1]
        if kind not in _SHOWN_BY:
            continue
        prefix = _BONES[name][column][: len("Left")] if numbered else name[0]
        if numbered:
            prefix = "Left" if name.startswith("left") else "Right"
        child = motion.names.index(prefix + _SHOWN_BY[kind][0 if numbered else 1])
        offset = np.asarray(motion.offsets[child], dtype=float)
        rotation[:, bone] = rotation[:, bone] @ turn_between(rest_direction(name), offset)
    shin, foot = (motion.names.index(_BONES[f"left_{b}"][column]) for b in ("shin", "foot"))
    leg = np.linalg.norm(motion.offsets[shin]) + np.linalg.norm(motion.offsets[foot])
    rate = 60.0 if "_salsa_" in path.stem else 1 / motion.frame_time_s
    first = 1 if numbered else 0  # the numbered files begin with an inserted rest pose
    return Performance(
        path.stem,
        rotation[first::every],
        np.asarray(motion.root_position[first::every]) / leg,
        rate / every,
    )
