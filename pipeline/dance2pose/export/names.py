"""Joint names as programs for motion analysis have them (those of Pose2Sim and BODY_25)."""

from __future__ import annotations

from dance2pose.export.scene import Performer
from dance2pose.skeleton import Skeleton

_WHOLE = {"pelvis": "CHip", "root": "CHip", "neck": "Neck", "upper_back": "Neck", "head": "Head"}
_PART = {"toe": "BigToe"}


def marker_names(skeleton: Skeleton) -> tuple[str, ...]:
    """RHip, LKnee, CHip, Neck, RBigToe … in the order of the skeleton."""
    return tuple(_marker(joint) for joint in skeleton.joints)


def labelled(performers: tuple[Performer, ...]) -> list[str]:
    """Marker names of all performers, with the dancer in front where there are several."""
    several = len(performers) > 1
    return [
        f"{performer.name}:{name}" if several else name
        for performer in performers
        for name in marker_names(performer.skeleton)
    ]


def _marker(joint: str) -> str:
    if joint in _WHOLE:
        return _WHOLE[joint]
    side, part = joint.split("_", 1)
    return side[0].upper() + _PART.get(part, part.title())
