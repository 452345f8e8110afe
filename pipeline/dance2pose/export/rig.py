"""Joint positions as an animated rig: constant offsets, and a rotation for every bone.

Every bone is a node of its own at the joint where it starts, so that hips and shoulders, whose
bones share that joint, keep their own directions. The rotation of a bone has two parts. Where it
points is known. How far it is twisted about itself is not, and is chosen: hips and spine follow the
lines of hips and shoulders; every other bone is carried along from frame to frame without twist
(parallel transport), and drifts back towards the shortest turn from the rest pose, slowly, and not
at all while it points the opposite way, where the shortest turn would flip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from dance2pose.body import bone_lengths
from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

# Time in which a twist goes back to 1/e of what it was.
_TWIST_RETURN_S = 0.5
_TINY = 1e-9

# The names of BVH files (MotionBuilder's, as the CMU database has them) of the node that sits at a
# joint and turns the bone that starts there.
_AT_JOINT = {
    "shoulder": "Arm",
    "elbow": "ForeArm",
    "wrist": "Hand",
    "hip": "UpLeg",
    "knee": "Leg",
    "ankle": "Foot",
    "toe": "ToeBase",
}


@dataclass(frozen=True)
class Node:
    """A joint of the rig. parent: index, -1 for the root. joint: index in the skeleton of the
    joint where it sits. bone: index of the bone that it turns, None for the root and the ends."""

    name: str
    parent: int
    joint: int
    bone: int | None


@dataclass(frozen=True)
class Rig:
    """A skeleton as nodes, and one motion of it.

    offsets: (N, 3) from the parent node at rest, a T-pose that faces +z with its left at +x.
    lengths: (J - 1,) of the bones. root: (T, 3) places of the first node. turns: (T, N, 4) local
    rotations as quaternions x, y, z, w of child axes in the parent's axes.
    """

    nodes: tuple[Node, ...]
    offsets: FloatArray
    lengths: FloatArray
    root: FloatArray
    turns: FloatArray

    def node_at(self, joint: int) -> int:
        """The node that sits at a joint; the last of them where several bones start there."""
        if joint == 0:
            return 0
        return max(i for i, node in enumerate(self.nodes) if node.joint == joint)


def rest_directions(skeleton: Skeleton) -> FloatArray:
    """(J - 1, 3) unit vectors of the bones in a T-pose that faces +z, left at +x."""
    return np.array([_rest(skeleton.joints[child]) for _, child in skeleton.bones])


def make_rig(time_s: npt.NDArray[np.float64], xyz: FloatArray, skeleton: Skeleton) -> Rig:
    """The rig whose nodes follow positions (T, J, 3) without gaps at times (T,) s.

    Bone lengths are the medians over time; directions are kept exactly. A bone of which an end is
    never known stays as it is at rest.
    """
    nodes = _nodes(skeleton)
    lengths = np.nan_to_num(_lengths(xyz, skeleton))
    rest = rest_directions(skeleton)
    offsets = np.zeros((len(nodes), 3))
    for i, node in enumerate(nodes):
        before = nodes[node.parent].bone if node.parent >= 0 else None
        if before is not None:
            offsets[i] = lengths[before] * rest[before]
    turns = _turns(time_s, xyz, skeleton, nodes, rest)
    return Rig(nodes, offsets, lengths, np.nan_to_num(xyz[:, 0]), turns)


def forward_kinematics(rig: Rig) -> FloatArray:
    """(T, N, 3) places of the nodes."""
    places = np.zeros((len(rig.root), len(rig.nodes), 3))
    world: list[Rotation] = []
    for i, node in enumerate(rig.nodes):
        local = Rotation.from_quat(rig.turns[:, i])
        if node.parent < 0:
            places[:, i] = rig.root
            world.append(local)
        else:
            places[:, i] = places[:, node.parent] + world[node.parent].apply(rig.offsets[i])
            world.append(world[node.parent] * local)
    return places


def stretch(xyz: FloatArray, rig: Rig, skeleton: Skeleton) -> FloatArray:
    """(T, J) how far constant bone lengths moved each joint from (T, J, 3); NaN where missing."""
    places = forward_kinematics(rig)[:, [rig.node_at(j) for j in range(len(skeleton))]]
    moved: FloatArray = np.linalg.norm(places - xyz, axis=-1)
    return moved


def _rest(joint: str) -> tuple[float, float, float]:
    """Which way the bone that ends at a joint points at rest."""
    part = joint.removeprefix("left_").removeprefix("right_")
    side = 1.0 if joint.startswith("left_") else -1.0
    if part in ("knee", "ankle"):
        return 0.0, -1.0, 0.0
    if part == "toe":
        return 0.0, 0.0, 1.0
    return (0.0, 1.0, 0.0) if part == joint else (side, 0.0, 0.0)


def _lengths(xyz: FloatArray, skeleton: Skeleton) -> FloatArray:
    known = np.asarray(~np.isnan(xyz).all(axis=(0, 2)))
    lengths = np.full(len(skeleton) - 1, np.nan)
    usable = [b for b, (p, c) in enumerate(skeleton.bones) if known[p] and known[c]]
    lengths[usable] = bone_lengths(np.where(known[:, None], xyz, 0.0), skeleton)[usable]
    return lengths


def _nodes(skeleton: Skeleton) -> tuple[Node, ...]:
    nodes = [Node("Hips", -1, 0, None)]
    of_bone: dict[int, int] = {}
    for bone, (start, end) in enumerate(skeleton.bones):
        parent = of_bone[start - 1] if start else 0
        nodes.append(Node(_bone_name(skeleton, start, end), parent, start, bone))
        of_bone[bone] = len(nodes) - 1
    starts = {start for start, _ in skeleton.bones}
    for bone, (_, end) in enumerate(skeleton.bones):
        if end not in starts:
            nodes.append(Node(_joint_name(skeleton.joints[end]), of_bone[bone], end, None))
    return tuple(nodes)


def _bone_name(skeleton: Skeleton, start: int, end: int) -> str:
    name = skeleton.joints[end]
    if start == 0:
        return f"{name[0].upper()}HipJoint" if name.endswith("_hip") else "Spine"
    if name.endswith("_shoulder"):
        return f"{_side(name)}Shoulder"
    return "Neck" if name == "head" else _joint_name(skeleton.joints[start])


def _joint_name(joint: str) -> str:
    if "_" not in joint or joint == "upper_back":
        return joint.title().replace("_", "")
    return _side(joint) + _AT_JOINT[joint.split("_", 1)[1]]


def _side(joint: str) -> str:
    return "Left" if joint.startswith("left_") else "Right"


def _turns(
    time_s: npt.NDArray[np.float64],
    xyz: FloatArray,
    skeleton: Skeleton,
    nodes: tuple[Node, ...],
    rest: FloatArray,
) -> FloatArray:
    turns = np.zeros((len(xyz), len(nodes), 4))
    world: list[Rotation] = []
    for i, node in enumerate(nodes):
        if node.parent < 0:
            local = turn = _hips(xyz, skeleton)
        elif node.bone is None:
            local, turn = Rotation.identity(len(xyz)), world[node.parent]
        else:
            start, end = skeleton.bones[node.bone]
            inside = world[node.parent].inv()
            pointing = _directions(inside.apply(xyz[:, end] - xyz[:, start]), rest[node.bone])
            shoulders = _shoulder_line(xyz, skeleton) if nodes[i].name == "Spine" else None
            if shoulders is None:
                local = _transported(time_s, pointing, rest[node.bone])
            else:
                local = _frame(pointing, inside.apply(shoulders))
            turn = world[node.parent] * local
        turns[:, i] = _same_sign(local.as_quat())
        world.append(turn)
    return turns


def _hips(xyz: FloatArray, skeleton: Skeleton) -> Rotation:
    """The line of the hips to the left is x; up is as near to the spine as that allows."""
    left, right = skeleton.index("left_hip"), skeleton.index("right_hip")
    line = _directions(xyz[:, left] - xyz[:, right], np.array([1.0, 0, 0]))
    spine = _directions(xyz[:, 1] - xyz[:, 0], np.array([0, 1.0, 0]))
    return _rotation(line, _square(spine, line))


def _shoulder_line(xyz: FloatArray, skeleton: Skeleton) -> FloatArray | None:
    line: FloatArray = (
        xyz[:, skeleton.index("left_shoulder")] - xyz[:, skeleton.index("right_shoulder")]
    )
    return None if np.isnan(line).any() else line


def _frame(up: FloatArray, left: FloatArray) -> Rotation:
    return _rotation(_square(left, up), up)


def _rotation(x: FloatArray, y: FloatArray) -> Rotation:
    return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=-1))


def _square(vectors: FloatArray, to: FloatArray) -> FloatArray:
    """Unit vectors square to `to`, as near to `vectors` as that allows."""
    flat = vectors - (vectors * to).sum(axis=-1, keepdims=True) * to
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    other = np.eye(3)[np.abs(to).argmin(axis=-1)]
    spare = other - (other * to).sum(axis=-1, keepdims=True) * to
    flat = np.where(length > _TINY, flat, spare)
    square: FloatArray = flat / np.linalg.norm(flat, axis=-1, keepdims=True)
    return square


def _directions(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Vectors (T, 3) of length 1; `otherwise` (3,) where there is none."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = length > _TINY  # False for NaN
    found: FloatArray = np.where(known, vectors / np.where(known, length, 1.0), otherwise)
    return found


def _transported(
    time_s: npt.NDArray[np.float64], pointing: FloatArray, rest: FloatArray
) -> Rotation:
    """Rotations that take `rest` (3,) to `pointing` (T, 3), with the twist chosen here."""
    shortest = _shortest(np.broadcast_to(rest, pointing.shape), pointing)
    if len(pointing) == 1:
        return shortest
    carried = _shortest(pointing[:-1], pointing[1:]) * shortest[:-1]
    ahead = (carried * shortest[1:].inv()).as_quat()
    slip = 2 * np.arctan2((ahead[:, :3] * pointing[1:]).sum(axis=1), ahead[:, 3])
    # From 1 where the bone points as at rest to 0 where it points the opposite way.
    trust = (1 + pointing @ rest) / 2
    keep = np.exp(-np.diff(time_s) / _TWIST_RETURN_S * trust[1:] ** 2)
    twist = [0.0]
    for by, share in zip(slip.tolist(), keep.tolist(), strict=True):
        angle = (twist[-1] + by + np.pi) % (2 * np.pi) - np.pi
        twist.append(angle * share)
    return Rotation.from_rotvec(np.array(twist)[:, None] * pointing) * shortest


def _shortest(source: FloatArray, target: FloatArray) -> Rotation:
    """The shortest rotations from unit vectors (T, 3) to others."""
    w = 1 + (source * target).sum(axis=-1, keepdims=True)
    axis = np.cross(source, target)
    opposite = w < 1e-7
    spare = np.cross(source, np.eye(3)[np.abs(source).argmin(axis=-1)])
    return Rotation.from_quat(
        np.hstack([np.where(opposite, spare, axis), np.where(opposite, 0, w)])
    )


def _same_sign(quaternions: FloatArray) -> FloatArray:
    """The same rotations with signs that do not jump, for interpolation."""
    jumps = (quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0
    sign = np.cumprod(np.concatenate([[1.0], np.where(jumps, -1.0, 1.0)]))
    signed: FloatArray = quaternions * sign[:, None]
    return signed
