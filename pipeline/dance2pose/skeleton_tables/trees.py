"""Lifting skeletons: trees rooted at the pelvis in which 3D poses live."""

from __future__ import annotations

from dance2pose.skeleton_tables.model import Skeleton


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


TREES = (
    _body("cmu17", "root", "upper_back", toes=True, right_leg_first=False),
    _body("paper15", "pelvis", "neck", toes=False, right_leg_first=True),
    _body("body17", "pelvis", "neck", toes=True, right_leg_first=False),
)
