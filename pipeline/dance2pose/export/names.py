"""Joint names as programs for motion analysis have them (those of Pose2Sim and BODY_25)."""

from __future__ import annotations

from dance2pose.export.scene import SceneDancer
from dance2pose.skeleton import Skeleton

_WHOLE = {"pelvis": "CHip", "root": "CHip", "neck": "Neck", "upper_back": "Neck", "head": "Head"}
_PART = {"toe": "BigToe"}


def marker_names(skeleton: Skeleton) -> tuple[str, ...]:
    """RHip, LKnee, CHip, Neck, RBigToe … in the order of the skeleton."""
    return tuple(_marker(joint) for joint in skeleton.joints)


def labelled(dancers: tuple[SceneDancer, ...]) -> list[str]:
    """Marker names of all dancers, with the dancer in front where there are several."""
    several = len(dancers) > 1
    return [
        f"{dancer.name}:{name}" if several else name
        for dancer in dancers
        for name in marker_names(dancer.skeleton)
    ]


def _marker(joint: str) -> str:
    if joint in _WHOLE:
        return _WHOLE[joint]
    side, part = joint.split("_", 1)
    return side[0].upper() + _PART.get(part, part.title())
