"""Which joint a name means in the habits of many tools: `LKnee`, `knee_l`, `Left Knee`, `knee2`."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dance2pose import skeleton as skeletons
from dance2pose.skeleton_tables.model import Skeleton

_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_PARTS = {
    *("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "eye", "ear", "heel", "toe"),
    *("bigtoe", "smalltoe", "foot", "footindex", "hand", "thumb", "index", "pinky"),
    *("eyeinner", "eyeouter"),
}
# Words for one thing; what is not here stands for itself.
_SAME = {
    "midhip": "pelvis",
    "chip": "pelvis",
    "hip": "pelvis",
    "hips": "pelvis",
    "root": "pelvis",
    "hipcenter": "pelvis",
    "centerhip": "pelvis",
    "tophead": "headtop",
    "topofhead": "headtop",
    "forehead": "headtop",
    "leftmouth": "mouthleft",
    "rightmouth": "mouthright",
    "leftfoot": "leftankle",
    "rightfoot": "rightankle",
    "lefttoe": "leftbigtoe",
    "righttoe": "rightbigtoe",
    "leftfootindex": "leftbigtoe",
    "rightfootindex": "rightbigtoe",
}
# DeepLabCut's human model numbers the sides of MPII.
_NUMBERED = {"1": "right", "2": "left"}


def meaning(name: str) -> str:
    """The name without a tool's habits: side first, then the part, in lower case."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    words = [word for word in re.split(r"[^a-z0-9]+", spaced.lower()) if word]
    sides = [_SIDES[word] for word in words if word in _SIDES]
    part = "".join(word for word in words if word not in _SIDES)
    side = sides[0] if len(sides) == 1 else ""
    if not side:
        side, part = _side_within(part)
    found = f"{side}{part}"
    return _SAME.get(found, found)


def _side_within(part: str) -> tuple[str, str]:
    """`lshoulder`, `leftshoulder` and `shoulder1` taken apart."""
    for start, side in _SIDES.items():
        if part.startswith(start) and part.removeprefix(start) in _PARTS:
            return side, part.removeprefix(start)
    if part[-1:] in _NUMBERED and part[:-1] in _PARTS:
        return _NUMBERED[part[-1]], part[:-1]
    return "", part


def columns_of(names: Sequence[str], skeleton: Skeleton) -> dict[int, int]:
    """Which of the names is each joint of the skeleton: joint to place in the names."""
    exact = {name: place for place, name in reversed(list(enumerate(names)))}
    meant = {meaning(name): place for place, name in reversed(list(enumerate(names)))}
    found: dict[int, int] = {}
    for j, joint in enumerate(skeleton.joints):
        place = exact.get(joint, meant.get(meaning(joint)))
        if place is not None and place not in found.values():
            found[j] = place
    return found


def best_skeleton(names: Sequence[str], candidates: Sequence[str]) -> tuple[str, dict[int, int]]:
    """The skeleton that has most of the names; of those, what models emit before what poses are
    lifted to, and the one with fewest other keypoints."""
    matches = [(name, columns_of(names, skeletons.get(name))) for name in candidates]

    def fit(match: tuple[str, dict[int, int]]) -> tuple[int, bool, int]:
        skeleton = skeletons.get(match[0])
        return len(match[1]), not skeleton.is_tree, -len(skeleton)

    return max(matches, key=fit)
