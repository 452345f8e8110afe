"""A body: its proportions, its skin as one smooth surface, and the points a keypoint model names.

The surface is the zero level of a smooth union of tapered capsules and ellipsoids around the
resting bones, meshed by marching cubes and bound to the bones by distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skimage.measure import marching_cubes

from figure_renderer.rig import BONES, PARENTS, rest_direction
from figure_renderer.solids import Shape, body_solids

Array = npt.NDArray[np.float64]
WEIGHT_DISTANCE_M = 0.014
# Landmarks of the surface: bone they move with. Keypoints of coco23 first, in its order.
_KEYPOINT_BONES = (
    "head head head head head left_upper_arm right_upper_arm left_forearm right_forearm "
    "left_hand right_hand left_thigh right_thigh left_shin right_shin left_foot right_foot "
    "left_foot left_foot left_foot right_foot right_foot right_foot"
).split()


@dataclass(frozen=True)
class Body:
    """A meshed body at rest.

    joints: (B, 3) where each bone turns. keypoints: (23, 3) of coco23 at rest, moved by the bones
    keypoint_bones (23,). vertices, normals: (V, 3). faces: (F, 3). bone_index, bone_weight:
    (V, 4). coords: (V, 4): along the arm (0 shoulder, 1 wrist), how much nearer the arm than the
    trunk in metres, height / stature, down the leg (0 hip, 1 ankle).
    """

    shape: Shape
    joints: Array
    keypoints: Array
    keypoint_bones: npt.NDArray[np.int64]
    vertices: Array
    normals: Array
    faces: npt.NDArray[np.int32]
    bone_index: npt.NDArray[np.int32]
    bone_weight: Array
    coords: Array

    def posed_joints(self, rotation: Array, pelvis: Array) -> Array:
        """World positions (B, 3) of the bones' joints."""
        out = np.empty((len(BONES), 3))
        for b, parent in enumerate(PARENTS):
            out[b] = (
                pelvis
                if parent < 0
                else out[parent] + rotation[parent] @ (self.joints[b] - self.joints[parent])
            )
        return out

    def posed_keypoints(self, rotation: Array, posed: Array) -> Array:
        """World positions (23, 3) of the coco23 keypoints."""
        bones = self.keypoint_bones
        local = self.keypoints - self.joints[bones]
        return posed[bones] + np.einsum("kij,kj->ki", rotation[bones], local)

    @property
    def leg_length(self) -> float:
        thigh, foot = BONES.index("left_thigh"), BONES.index("left_foot")
        return float(self.joints[thigh, 1] - self.joints[foot, 1])


def rest_joints(shape: Shape) -> Array:
    """Where the bones turn in the resting figure, soles at y = 0."""
    s = shape.stature / 1.68
    knee, hip = 0.495 * s * shape.legs, 0.925 * s * shape.legs
    at = {
        "pelvis": (0, hip + 0.03 * s, 0),
        "spine": (0, hip + 0.13 * s, -0.01 * s),
        "chest": (0, hip + 0.26 * s, -0.015 * s),
        "neck": (0, hip + 0.505 * s, -0.03 * s),
        "head": (0, hip + 0.585 * s, -0.01 * s),
    }
    for sign, side in ((1, "left"), (-1, "right")):
        shoulder = np.array(
            [sign * 0.172 * s * shape.shoulders, hip + 0.462 * s, -0.022 * s], dtype=float
        )
        arm = rest_direction(f"{side}_upper_arm")
        elbow = shoulder + arm * 0.283 * s * shape.arms
        hip_x = sign * 0.088 * s * shape.hips
        at |= {
            f"{side}_collar": (sign * 0.03 * s, hip + 0.455 * s, -0.01 * s),
            f"{side}_upper_arm": shoulder,
            f"{side}_forearm": elbow,
            f"{side}_hand": elbow + arm * 0.245 * s * shape.arms,
            f"{side}_thigh": (hip_x, hip, 0),
            f"{side}_shin": (hip_x, knee, 0),
            f"{side}_foot": (hip_x, 0.082 * s, 0),
        }
    return np.array([at[bone] for bone in BONES], dtype=float)


def _rest_keypoints(shape: Shape, joints: Array) -> Array:
    s, h = shape.stature / 1.68, shape.stature / 1.68 * shape.head
    head = joints[BONES.index("head")]
    face = [
        (0, 0.035, 0.107),
        (0.032, 0.068, 0.085),
        (-0.032, 0.068, 0.085),
        (0.074, 0.052, 0.0),
        (-0.074, 0.052, 0.0),
    ]
    points = [head + h * np.array(p) for p in face]
    for bone in _KEYPOINT_BONES[5:17]:
        points.append(joints[BONES.index(bone)])
    for sign, side in ((1, "left"), (-1, "right")):
        ankle = joints[BONES.index(f"{side}_foot")]
        for x, y, z in ((-0.012, -0.062, 0.185), (0.045, -0.066, 0.145), (0.0, -0.05, -0.055)):
            points.append(ankle + s * np.array([sign * x, y, z]))
    return np.array(points)


def build_body(shape: Shape, *, cell_m: float = 0.013) -> Body:
    """Mesh a body; finer cells for close views."""
    joints = rest_joints(shape)
    low = joints.min(0) - np.array([0.28, 0.12, 0.17])
    high = joints.max(0) + np.array([0.28, 0.30, 0.27])
    axes = [np.arange(a, b, cell_m) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    field = _field(grid, shape, joints)
    vertices, faces, normals, _ = marching_cubes(
        field, 0.0, spacing=(cell_m,) * 3, gradient_direction="ascent"
    )
    vertices = vertices + low
    solids = body_solids(vertices, shape, joints)
    index, weight = _bind(solids.of_bone())
    return Body(
        shape=shape,
        joints=joints,
        keypoints=_rest_keypoints(shape, joints),
        keypoint_bones=np.array([BONES.index(b) for b in _KEYPOINT_BONES]),
        vertices=vertices,
        normals=normals,
        faces=faces.astype(np.int32),
        bone_index=index,
        bone_weight=weight,
        coords=_coords(vertices, solids.of_bone(), shape, joints),
    )


def _field(grid: Array, shape: Shape, joints: Array) -> Array:
    """The distance field on the grid: coarse first, fine only near the surface."""
    step = 4
    coarse = grid[::step, ::step, ::step]
    rough = body_solids(coarse.reshape(-1, 3), shape, joints).union().reshape(coarse.shape[:3])
    for axis in range(3):
        rough = rough.repeat(step, axis)
    out = rough[tuple(slice(n) for n in grid.shape[:3])].copy()
    cell = float(grid[1, 0, 0, 0] - grid[0, 0, 0, 0])
    near = np.abs(out) < step * cell * 1.8
    out[near] = body_solids(grid[near], shape, joints).union()
    return out


def _bind(distance: Array) -> tuple[npt.NDArray[np.int32], Array]:
    """Up to four bones a vertex, weighted by distance, among the nearest and its neighbours."""
    nearest = distance.argmin(1)
    allowed = np.eye(len(BONES), dtype=bool)
    for child, parent in enumerate(PARENTS):
        if parent >= 0:
            allowed[child, parent] = allowed[parent, child] = True
    for side in ("left", "right"):  # the armpit moves with chest and arm, the collar between them
        a, b = BONES.index("chest"), BONES.index(f"{side}_upper_arm")
        allowed[a, b] = allowed[b, a] = True
    least = distance.min(1, keepdims=True)
    weight = np.exp(-np.minimum((distance - least) / WEIGHT_DISTANCE_M, 60))
    weight = np.where(allowed[nearest], weight, 0)
    index = np.argsort(-weight, axis=1)[:, :4]
    weight = np.take_along_axis(weight, index, 1)
    return index.astype(np.int32), weight / weight.sum(1, keepdims=True)


def _coords(vertices: Array, distance: Array, shape: Shape, joints: Array) -> Array:
    at = dict(zip(BONES, joints, strict=True))
    arm_bones = [i for i, b in enumerate(BONES) if b.endswith(("arm", "hand"))]
    trunk = [BONES.index(b) for b in ("pelvis", "spine", "chest", "neck", "head")]
    mirrored = vertices * np.array([1.0, 1.0, 1.0])
    mirrored[:, 0] = np.abs(mirrored[:, 0])
    shoulder, wrist = at["left_upper_arm"], at["left_hand"]
    axis = wrist - shoulder
    arm = (mirrored - shoulder) @ axis / (axis @ axis)
    hip, ankle = at["left_thigh"], at["left_foot"]
    leg = (hip[1] - vertices[:, 1]) / (hip[1] - ankle[1])
    nearer = distance[:, trunk].min(1) - distance[:, arm_bones].min(1)
    return np.stack([arm, nearer, vertices[:, 1] / shape.stature, leg], axis=1)
