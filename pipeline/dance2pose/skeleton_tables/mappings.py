"""How a joint of one skeleton is made of keypoints of another: the mean of those named.

A target joint that is neither listed nor present under its own name in the source is missing.
"""

from __future__ import annotations

Parts = dict[str, tuple[str, ...]]

_EARS = ("left_ear", "right_ear")
_SHOULDERS = ("left_shoulder", "right_shoulder")
_HIPS = ("left_hip", "right_hip")
_MIDPOINTS: Parts = {"pelvis": _HIPS, "neck": _SHOULDERS, "head": _EARS}
_WITH_FEET: Parts = _MIDPOINTS | {
    "left_toe": ("left_big_toe",),
    "right_toe": ("right_big_toe",),
}

MAPPINGS: dict[tuple[str, str], Parts] = {
    ("cmu17", "paper15"): {"pelvis": ("root",), "neck": ("upper_back",)},
    ("paper15", "cmu17"): {"root": ("pelvis",), "upper_back": ("neck",)},
    ("cmu17", "body17"): {"pelvis": _HIPS, "neck": _SHOULDERS},
    ("coco17", "body17"): _MIDPOINTS,
    ("coco18", "body17"): _MIDPOINTS,
    ("coco23", "body17"): _WITH_FEET,
    ("halpe26", "body17"): _WITH_FEET,
    ("halpe136", "body17"): _WITH_FEET,
    ("wholebody133", "body17"): _WITH_FEET,
    ("body25", "body17"): _WITH_FEET,
    ("body25b", "body17"): _WITH_FEET,
    ("mpii16", "body17"): _MIDPOINTS | {"head": ("upper_neck", "head_top")},
    ("h36m17", "body17"): _MIDPOINTS
    | {
        "head": ("neck_base", "head"),
        "left_ankle": ("left_foot",),
        "right_ankle": ("right_foot",),
    },
    ("blazepose33", "body17"): _MIDPOINTS
    | {"left_toe": ("left_foot_index",), "right_toe": ("right_foot_index",)},
}

# Which skeletons are published with so many keypoints; the first is meant where nobody says.
SKELETONS_BY_COUNT: dict[int, tuple[str, ...]] = {
    16: ("mpii16",),
    17: ("coco17", "h36m17"),
    18: ("coco18",),
    23: ("coco23",),
    25: ("body25", "body25b"),
    26: ("halpe26",),
    33: ("blazepose33",),
    133: ("wholebody133",),
    136: ("halpe136",),
}
