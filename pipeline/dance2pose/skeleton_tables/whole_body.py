"""Whole-body keypoint skeletons: a body, the 68 points of a face (iBUG), 21 points a hand."""

from __future__ import annotations

from itertools import pairwise

from dance2pose.skeleton_tables.keypoints import (
    COCO17,
    COCO_FEET,
    FACE,
    FEET,
    HALPE26,
    LIMBS,
    TRUNK_SIDES,
    Edges,
    keypoints,
)


def _numbered(name: str, numbers: range) -> list[str]:
    return [f"{name}_{n}" for n in numbers]


# In the order of iBUG's 68 points. Left and right are the person's own; what has the same number
# on both sides is each other's mirror image.
_FACE_PARTS: tuple[list[str], ...] = (
    [*_numbered("right_jaw", range(1, 9)), "chin", *_numbered("left_jaw", range(8, 0, -1))],
    _numbered("right_eyebrow", range(1, 6)),
    _numbered("left_eyebrow", range(5, 0, -1)),
    _numbered("nose_bridge", range(1, 5)),
    ["right_nostril_1", "right_nostril_2", "nose_base", "left_nostril_2", "left_nostril_1"],
    _numbered("right_eyelid", range(1, 7)),
    [f"left_eyelid_{n}" for n in (4, 3, 2, 1, 6, 5)],
    [
        *_numbered("right_lip", range(1, 4)),
        "lip_top",
        *_numbered("left_lip", range(3, 0, -1)),
        *("left_lip_4", "left_lip_5", "lip_bottom", "right_lip_5", "right_lip_4"),
    ],
    [
        *("right_inner_lip_1", "right_inner_lip_2", "inner_lip_top", "left_inner_lip_2"),
        *("left_inner_lip_1", "left_inner_lip_3", "inner_lip_bottom", "right_inner_lip_3"),
    ],
)
# Of these parts the last point is joined to the first: eyelids and lips.
_CLOSED = (5, 6, 7, 8)
_FINGERS = ("thumb", "index_finger", "middle_finger", "ring_finger", "pinky_finger")


def _face() -> tuple[str, Edges]:
    joints = [name for part in _FACE_PARTS for name in part]
    edges = [edge for part in _FACE_PARTS for edge in pairwise(part)]
    edges += [(_FACE_PARTS[n][-1], _FACE_PARTS[n][0]) for n in _CLOSED]
    return " ".join(joints), tuple(edges)


def _hand(side: str) -> tuple[str, Edges]:
    root = f"{side}_hand_root"
    fingers = [[f"{side}_{finger}_{n}" for n in range(1, 5)] for finger in _FINGERS]
    edges = [edge for finger in fingers for edge in pairwise([root, *finger])]
    edges.append((f"{side}_wrist", root))
    return " ".join([root, *(name for finger in fingers for name in finger)]), tuple(edges)


FIRST_OF_FACE = _FACE_PARTS[0][0]
_face_joints, _face_edges = _face()
_left, _left_edges = _hand("left")
_right, _right_edges = _hand("right")
_PARTS = f"{_face_joints} {_left} {_right}"
_PART_EDGES: Edges = (*_face_edges, *_left_edges, *_right_edges)

WHOLE_BODIES = (
    # COCO-WholeBody (Jin et al., ECCV 2020).
    keypoints(
        "wholebody133",
        f"{COCO17} {COCO_FEET} {_PARTS}",
        (*FACE, *TRUNK_SIDES, *LIMBS, *FEET, *_PART_EDGES),
    ),
    # Halpe Full-Body (Li et al., CVPR 2020), AlphaPose's 136.
    keypoints(
        "halpe136",
        f"{HALPE26} {_PARTS}",
        (*FACE, ("head", "neck"), ("neck", "hip"), *LIMBS, *FEET, *_PART_EDGES),
    ),
)
