"""Skeletons as data: names, bones, mirror images, and the mappings between them.

Two families. Keypoint skeletons (coco17, halpe26, ...) are what 2D models emit, in their
publishers' order and names. Lifting skeletons (cmu17, paper15, body17) are trees rooted at the
pelvis in which 3D poses live. `cmu17` has the joints of Akhter & Black (CVPR 2015) as the CMU rig
places them; `paper15` is the same without toes, in the order of the paper's tables; `body17` has
cmu17's tree with pelvis, neck and head where keypoint models see them (midpoints of hips,
shoulders and ears).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.poses import FloatArray


@dataclass(frozen=True)
class Skeleton:
    """Joint (or keypoint) names and the lines between them.

    edges: pairs of names; in a lifting skeleton these are the bones (parent, child), and bone b
    ends at joint b + 1, so that there is one edge for every joint but the first.
    """

    name: str
    joints: tuple[str, ...]
    edges: tuple[tuple[str, str], ...]

    def __len__(self) -> int:
        return len(self.joints)

    def index(self, joint: str) -> int:
        """Index of a joint by name; UsageError names the known ones."""
        try:
            return self.joints.index(joint)
        except ValueError:
            known = ", ".join(self.joints)
            raise UsageError(f"{self.name} has no joint {joint!r}; it has: {known}") from None

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """The edges as pairs of indices."""
        return tuple((self.joints.index(a), self.joints.index(b)) for a, b in self.edges)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """Parent index of every joint, -1 for the root; only lifting skeletons are trees."""
        if not self.is_tree:
            raise UsageError(f"skeleton {self.name} is a set of keypoints, not a tree of bones")
        return (-1, *(parent for parent, _ in self.bones))

    @cached_property
    def is_tree(self) -> bool:
        return [child for _, child in self.bones] == list(range(1, len(self.joints)))

    @cached_property
    def mirror(self) -> tuple[int, ...]:
        """Permutation of joint indices that swaps left and right."""

        def swapped(name: str) -> str:
            for side, other in (("left", "right"), ("right", "left")):
                if side in name.split("_"):
                    return "_".join(other if part == side else part for part in name.split("_"))
            return name

        return tuple(self.joints.index(swapped(name)) for name in self.joints)


def _tree(name: str, bones: str) -> Skeleton:
    """A lifting skeleton from 'root, child<parent, ...'."""
    root, *rest = [word.strip() for word in bones.split(",")]
    pairs = [tuple(word.split("<")) for word in rest]
    return Skeleton(name, (root, *(c for c, _ in pairs)), tuple((p, c) for c, p in pairs))


_LEG = "{s}_hip<{root},{s}_knee<{s}_hip,{s}_ankle<{s}_knee"
_ARM = "{s}_shoulder<{neck},{s}_elbow<{s}_shoulder,{s}_wrist<{s}_elbow"


def _body(name: str, root: str, neck: str, *, toes: bool, right_leg_first: bool) -> Skeleton:
    arms = [_ARM.format(s=side, neck=neck) for side in ("left", "right")]
    sides = ("right", "left") if right_leg_first else ("left", "right")
    toe = ",{s}_toe<{s}_ankle" if toes else ""
    legs = [(_LEG + toe).format(s=side, root=root) for side in sides]
    return _tree(name, ",".join([root, f"{neck}<{root}", *arms, f"head<{neck}", *legs]))


_LIMBS = (
    ("left_shoulder", "right_shoulder"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_hip", "right_hip"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
)
_TRUNK_SIDES = (("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"))
_FACE = (
    ("nose", "left_eye"),
    ("nose", "right_eye"),
    ("left_eye", "left_ear"),
    ("right_eye", "right_ear"),
)
_FEET = (
    ("left_ankle", "left_big_toe"),
    ("left_ankle", "left_small_toe"),
    ("left_ankle", "left_heel"),
    ("right_ankle", "right_big_toe"),
    ("right_ankle", "right_small_toe"),
    ("right_ankle", "right_heel"),
)
_COCO17 = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow "
    "right_elbow left_wrist right_wrist left_hip right_hip left_knee right_knee left_ankle "
    "right_ankle"
)

_SKELETONS = (
    _body("cmu17", "root", "upper_back", toes=True, right_leg_first=False),
    _body("paper15", "pelvis", "neck", toes=False, right_leg_first=True),
    _body("body17", "pelvis", "neck", toes=True, right_leg_first=False),
    Skeleton("coco17", tuple(_COCO17.split()), _FACE + _TRUNK_SIDES + _LIMBS),
    # COCO-17 and the six foot keypoints, as the first 23 of COCO-WholeBody.
    Skeleton(
        "coco23",
        tuple(
            (
                _COCO17 + " left_big_toe left_small_toe left_heel right_big_toe right_small_toe "
                "right_heel"
            ).split()
        ),
        _FACE + _TRUNK_SIDES + _LIMBS + _FEET,
    ),
    Skeleton(
        "halpe26",
        tuple(
            (
                _COCO17 + " head neck hip left_big_toe right_big_toe left_small_toe "
                "right_small_toe left_heel right_heel"
            ).split()
        ),
        (*_FACE, ("head", "neck"), ("neck", "hip"), *_LIMBS, *_FEET),
    ),
    Skeleton(
        "body25",
        tuple(
            (
                "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow "
                "left_wrist mid_hip right_hip right_knee right_ankle left_hip left_knee "
                "left_ankle right_eye left_eye right_ear left_ear left_big_toe left_small_toe "
                "left_heel right_big_toe right_small_toe right_heel"
            ).split()
        ),
        (*_FACE, ("nose", "neck"), ("neck", "mid_hip"), *_LIMBS, *_FEET),
    ),
    Skeleton(
        "mpii16",
        tuple(
            (
                "right_ankle right_knee right_hip left_hip left_knee left_ankle pelvis thorax "
                "upper_neck head_top right_wrist right_elbow right_shoulder left_shoulder "
                "left_elbow left_wrist"
            ).split()
        ),
        (("head_top", "upper_neck"), ("upper_neck", "thorax"), ("thorax", "pelvis"), *_LIMBS),
    ),
    Skeleton(
        "h36m17",
        tuple(
            (
                "root right_hip right_knee right_foot left_hip left_knee left_foot spine thorax "
                "neck_base head left_shoulder left_elbow left_wrist right_shoulder right_elbow "
                "right_wrist"
            ).split()
        ),
        (
            ("root", "spine"),
            ("spine", "thorax"),
            ("thorax", "neck_base"),
            ("neck_base", "head"),
            *_LIMBS[:7],
            ("left_knee", "left_foot"),
            _LIMBS[8],
            ("right_knee", "right_foot"),
        ),
    ),
    Skeleton(
        "blazepose33",
        tuple(
            (
                "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye "
                "right_eye_outer left_ear right_ear mouth_left mouth_right left_shoulder "
                "right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky "
                "right_pinky left_index right_index left_thumb right_thumb left_hip right_hip "
                "left_knee right_knee left_ankle right_ankle left_heel right_heel "
                "left_foot_index right_foot_index"
            ).split()
        ),
        (
            *_FACE,
            ("mouth_left", "mouth_right"),
            *_TRUNK_SIDES,
            *_LIMBS,
            ("left_wrist", "left_index"),
            ("left_wrist", "left_thumb"),
            ("left_wrist", "left_pinky"),
            ("right_wrist", "right_index"),
            ("right_wrist", "right_thumb"),
            ("right_wrist", "right_pinky"),
            ("left_ankle", "left_heel"),
            ("left_heel", "left_foot_index"),
            ("right_ankle", "right_heel"),
            ("right_heel", "right_foot_index"),
        ),
    ),
)
_BY_NAME = {skeleton.name: skeleton for skeleton in _SKELETONS}

# How a target joint is made of source keypoints: the mean of those named. A target joint that is
# neither listed nor present under its own name in the source is missing (NaN).
_EARS = ("left_ear", "right_ear")
_SHOULDERS = ("left_shoulder", "right_shoulder")
_HIPS = ("left_hip", "right_hip")
_MIDPOINTS: dict[str, tuple[str, ...]] = {"pelvis": _HIPS, "neck": _SHOULDERS, "head": _EARS}
_BIG_TOES: dict[str, tuple[str, ...]] = {
    "left_toe": ("left_big_toe",),
    "right_toe": ("right_big_toe",),
}
_MAPPINGS: dict[tuple[str, str], dict[str, tuple[str, ...]]] = {
    ("cmu17", "paper15"): {"pelvis": ("root",), "neck": ("upper_back",)},
    ("paper15", "cmu17"): {"root": ("pelvis",), "upper_back": ("neck",)},
    ("cmu17", "body17"): {"pelvis": _HIPS, "neck": _SHOULDERS},
    ("coco17", "body17"): _MIDPOINTS,
    ("coco23", "body17"): _MIDPOINTS | _BIG_TOES,
    ("halpe26", "body17"): _MIDPOINTS | _BIG_TOES,
    ("body25", "body17"): _MIDPOINTS | _BIG_TOES,
    ("mpii16", "body17"): {**_MIDPOINTS, "head": ("upper_neck", "head_top")},
    ("h36m17", "body17"): {
        **_MIDPOINTS,
        "head": ("neck_base", "head"),
        "left_ankle": ("left_foot",),
        "right_ankle": ("right_foot",),
    },
    ("blazepose33", "body17"): {
        **_MIDPOINTS,
        "left_toe": ("left_foot_index",),
        "right_toe": ("right_foot_index",),
    },
}


def names() -> tuple[str, ...]:
    """The names of all skeletons."""
    return tuple(_BY_NAME)


def get(name: str) -> Skeleton:
    """The skeleton of that name; UsageError lists the known ones."""
    try:
        return _BY_NAME[name]
    except KeyError:
        raise UsageError(f"unknown skeleton {name!r}; known: {', '.join(_BY_NAME)}") from None


def lifting_skeleton(name: str) -> Skeleton:
    """The skeleton in which poses of skeleton `name` are lifted: itself if a tree, else body17."""
    skeleton = get(name)
    return skeleton if skeleton.is_tree else _BY_NAME["body17"]


def convert(
    values: FloatArray, confidence: FloatArray, *, source: str, target: str
) -> tuple[FloatArray, FloatArray]:
    """Points of one skeleton as points of another, by name and by the stated midpoints.

    values: (..., J_source, D); confidence: (..., J_source). Returns (..., J_target, D) and
    (..., J_target): a joint made of several keypoints is their mean and as sure as the least
    sure of them; one that the source does not have, or has as NaN, is NaN with confidence 0.
    """
    if source == target:
        return values, confidence
    from_skeleton, to_skeleton = get(source), get(target)
    special = _MAPPINGS.get((source, target), {})
    out = np.full((*values.shape[:-2], len(to_skeleton), values.shape[-1]), np.nan, values.dtype)
    out_confidence = np.zeros((*confidence.shape[:-1], len(to_skeleton)), confidence.dtype)
    for j, joint in enumerate(to_skeleton.joints):
        parts = special.get(joint, (joint,))
        if not all(part in from_skeleton.joints for part in parts):
            continue
        columns = [from_skeleton.joints.index(part) for part in parts]
        out[..., j, :] = values[..., columns, :].mean(axis=-2)
        out_confidence[..., j] = confidence[..., columns].min(axis=-1)
    out_confidence[np.isnan(out).any(axis=-1)] = 0
    return out, out_confidence
