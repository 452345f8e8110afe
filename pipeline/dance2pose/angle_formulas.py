"""The formulas of the joint angles: from points (..., P, 3) in any unit to radians (...).

See `angles` for what each one means and where it is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dance2pose.poses import BoolArray, FloatArray

# Nearer than this to the pole of its coordinate system, an angle says nothing.
_POLE = np.sin(np.radians(10.0))
# How far a knee or elbow must be from straight, and from folded, to show a plane.
_LEAST_BEND = np.sin(np.radians(30.0))
# A line of hips steeper than this gives the trunk no forward direction.
_STEEPEST_HIPS = np.cos(np.radians(60.0))
_UP = np.array([0.0, 1.0, 0.0])

Formula = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Definition:
    """joints: names of the points that `formula` takes as (..., P, 3) and turns into radians.
    wraps: whether the angle goes round, and is unwrapped over time."""

    joints: tuple[str, ...]
    formula: Formula
    wraps: bool = False


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = (a * b).sum(axis=-1)
    return product


def _unit(v: FloatArray) -> FloatArray:
    """Vectors of length 1, NaN where there was no length."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    out: FloatArray = np.divide(v, length, out=np.full(v.shape, np.nan), where=length > 0)
    return out


def _between(u: FloatArray, v: FloatArray) -> FloatArray:
    """Angle between vectors, radians: the two-argument arctangent stays exact near 0 and π."""
    across = np.linalg.norm(np.cross(u, v), axis=-1)
    angle: FloatArray = np.arctan2(across, _dot(u, v))
    no_length = (np.linalg.norm(u, axis=-1) == 0) | (np.linalg.norm(v, axis=-1) == 0)
    return np.where(no_length, np.nan, angle)


def _only_where(condition: BoolArray, angle: FloatArray) -> FloatArray:
    return np.where(condition, angle, np.nan)


def flexion_of_hinge(p: FloatArray) -> FloatArray:
    """Of a knee or elbow (..., 3, 3), between the ends of its limb: how far it is from straight."""
    return np.pi - _between(p[..., 0, :] - p[..., 1, :], p[..., 2, :] - p[..., 1, :])


def _dorsiflexion(p: FloatArray) -> FloatArray:
    """Of the ankle: 0 where the line to the big toe is square to the shin."""
    return np.pi / 2 - _between(p[..., 0, :] - p[..., 1, :], p[..., 2, :] - p[..., 1, :])


def hip_axes(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forward, up and right of the trunk at the hips, from pelvis, neck, left and right hip: the
    line of the hips is kept, the line to the neck made square to it."""
    right = _unit(p[..., 3, :] - p[..., 2, :])
    forward = _unit(np.cross(p[..., 1, :] - p[..., 0, :], right))
    return forward, np.cross(right, forward), right


def _shoulder_axes(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forward, up and right of the trunk at the shoulders, from pelvis, neck, left and right
    shoulder: the line to the neck is kept, the line of the shoulders made square to it."""
    up = _unit(p[..., 1, :] - p[..., 0, :])
    forward = _unit(np.cross(up, p[..., 3, :] - p[..., 2, :]))
    return forward, up, np.cross(forward, up)


Axes = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def _flexion(axes: Axes) -> Formula:
    def formula(p: FloatArray) -> FloatArray:
        forward, up, _ = axes(p)
        limb = _unit(p[..., 5, :] - p[..., 4, :])
        ahead, down = _dot(limb, forward), -_dot(limb, up)
        return _only_where(np.hypot(ahead, down) > _POLE, np.arctan2(ahead, down))

    return formula


def _abduction(axes: Axes, outwards: int) -> Formula:
    """outwards: 1 on the right, -1 on the left."""

    def formula(p: FloatArray) -> FloatArray:
        forward, up, right = axes(p)
        limb = p[..., 5, :] - p[..., 4, :]
        flat = np.hypot(_dot(limb, forward), _dot(limb, up))
        angle: FloatArray = np.arctan2(outwards * _dot(limb, right), flat)
        return angle

    return formula


def _rotation(axes: Axes, outwards: int, bends: int) -> Formula:
    """Internal rotation, from the plane of the next joint. bends: 1 where that bends the limb's
    end forward (elbow), -1 where backward (knee)."""

    def formula(p: FloatArray) -> FloatArray:
        _, _, right = axes(p)
        limb = _unit(p[..., 5, :] - p[..., 4, :])
        hinge = bends * np.cross(limb, _unit(p[..., 6, :] - p[..., 5, :]))
        floating = np.cross(-limb, right)
        ahead = np.cross(-limb, hinge)
        angle = np.arctan2(_dot(ahead, np.cross(-limb, floating)), _dot(ahead, floating))
        told = (np.linalg.norm(hinge, axis=-1) > _LEAST_BEND) & (
            np.linalg.norm(floating, axis=-1) > _POLE
        )
        return _only_where(told, outwards * angle)

    return formula


def _elevation(p: FloatArray) -> FloatArray:
    """Of the upper arm: from hanging along the trunk, in whichever plane."""
    return _between(p[..., 0, :] - p[..., 1, :], p[..., 3, :] - p[..., 2, :])


def _lean(p: FloatArray) -> FloatArray:
    up = p[..., 1, :] - p[..., 0, :]
    return _between(up, np.broadcast_to(_UP, up.shape))


def _lean_towards(*, forward: bool) -> Formula:
    """The lean as seen from the side (forward is positive) or from behind (right is positive)."""

    def formula(p: FloatArray) -> FloatArray:
        trunk = _unit(p[..., 1, :] - p[..., 0, :])
        hips = _unit(p[..., 3, :] - p[..., 2, :])
        flat = hips - _dot(hips, _UP)[..., None] * _UP
        right = _unit(flat)
        side = np.cross(_UP, right) if forward else right
        across, along = _dot(trunk, side), _dot(trunk, _UP)
        told = (np.linalg.norm(flat, axis=-1) > _STEEPEST_HIPS) & (np.hypot(across, along) > _POLE)
        return _only_where(told, np.arctan2(across, along))

    return formula


def _trunk_rotation(p: FloatArray) -> FloatArray:
    """Of the shoulders against the hips about the trunk; to the left is positive."""
    trunk = _unit(p[..., 1, :] - p[..., 0, :])
    hips, shoulders = p[..., 3, :] - p[..., 2, :], p[..., 5, :] - p[..., 4, :]
    hips = hips - _dot(hips, trunk)[..., None] * trunk
    shoulders = shoulders - _dot(shoulders, trunk)[..., None] * trunk
    angle: FloatArray = np.arctan2(_dot(trunk, np.cross(hips, shoulders)), _dot(hips, shoulders))
    return angle


def _of_both_sides() -> dict[str, Definition]:
    found: dict[str, Definition] = {}
    for kind in _LIMB_ANGLES:
        for side, outwards in (("left", -1), ("right", 1)):
            found[f"{side}_{kind}"] = _limb_angle(kind, side, outwards)
    return found


_LIMB_ANGLES = (
    *("elbow_flexion", "shoulder_flexion", "shoulder_abduction", "shoulder_elevation"),
    *("shoulder_rotation", "hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion"),
    "ankle_flexion",
)


def _limb_angle(kind: str, side: str, outwards: int) -> Definition:
    trunk = ("pelvis", "neck")
    arm = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist"))
    leg = tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle"))
    at_shoulders = (*trunk, "left_shoulder", "right_shoulder")
    at_hips = (*trunk, "left_hip", "right_hip")
    match kind:
        case "elbow_flexion":
            return Definition(arm, flexion_of_hinge)
        case "knee_flexion":
            return Definition(leg, flexion_of_hinge)
        case "ankle_flexion":
            return Definition((*leg[1:], f"{side}_toe"), _dorsiflexion)
        case "shoulder_elevation":
            return Definition((*trunk, *arm[:2]), _elevation)
        case "shoulder_flexion":
            return Definition((*at_shoulders, *arm[:2]), _flexion(_shoulder_axes), wraps=True)
        case "shoulder_abduction":
            return Definition((*at_shoulders, *arm[:2]), _abduction(_shoulder_axes, outwards))
        case "shoulder_rotation":
            turn = _rotation(_shoulder_axes, outwards, bends=1)
            return Definition((*at_shoulders, *arm), turn, wraps=True)
        case "hip_flexion":
            return Definition((*at_hips, *leg[:2]), _flexion(hip_axes), wraps=True)
        case "hip_abduction":
            return Definition((*at_hips, *leg[:2]), _abduction(hip_axes, outwards))
        case _:
            turn = _rotation(hip_axes, outwards, bends=-1)
            return Definition((*at_hips, *leg), turn, wraps=True)


DEFINITIONS = {
    **_of_both_sides(),
    "trunk_lean": Definition(("pelvis", "neck"), _lean),
    "trunk_lean_forward": Definition(
        ("pelvis", "neck", "left_hip", "right_hip"), _lean_towards(forward=True), wraps=True
    ),
    "trunk_lean_right": Definition(
        ("pelvis", "neck", "left_hip", "right_hip"), _lean_towards(forward=False), wraps=True
    ),
    "trunk_rotation": Definition(
        ("pelvis", "neck", "left_hip", "right_hip", "left_shoulder", "right_shoulder"),
        _trunk_rotation,
        wraps=True,
    ),
}
