"""Joint angles by name, in degrees, with their uncertainty.

Signs are those of the International Society of Biomechanics (Wu et al. 2002 for hip and ankle,
2005 for the shoulder; the hip after Grood and Suntay 1983): flexion, dorsiflexion and internal
rotation are positive, a straight limb is 0. Abduction is given positive, as dancers and
physiotherapists say it. Angles are read from joint centres alone:

- The pelvis is not seen, only the line of the hips and the line from pelvis to neck. So hip angles
  are those of the thigh to the trunk, and shoulder angles those of the upper arm to the trunk.
- Flexion and abduction are the first two turns of one joint coordinate system, flexion first. Next
  to its pole (abduction of 80° and more) flexion is not defined, and left out.
- The axial rotation of thigh and upper arm shows only in the plane of a bent knee or elbow: it is
  left out where that is bent by less than 30° or more than 150°. That of forearm, shin, foot and
  head shows in none of the joints and is not claimed; so is the side a straight knee bends to.

Trunk lean is measured against the y axis of the world: the vertical where the lifter levelled the
floor, else the camera's own upright.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.poses import BoolArray, FloatArray, Track3D
from dance2pose.skeleton import get

# The same place under the names of cmu17.
_SAME_PLACE = {"root": "pelvis", "upper_back": "neck"}
# Nearer than this to the pole of its coordinate system, an angle says nothing.
_POLE = np.sin(np.radians(10.0))
# How far a knee or elbow must be from straight, and from folded, to show a plane.
_LEAST_BEND = np.sin(np.radians(30.0))
# A line of hips steeper than this gives the trunk no forward direction.
_STEEPEST_HIPS = np.cos(np.radians(60.0))
_UP = np.array([0.0, 1.0, 0.0])
# Step of the numerical derivative, as a share of the distance between the joints of an angle.
_STEP = 1e-5

Formula = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class AngleCurve:
    """An angle over time: degrees (T,), NaN where it is not defined or a joint is missing, and
    sigma_deg (T,), its standard deviation, or None where the lifter gives no uncertainty."""

    name: str
    degrees: FloatArray
    sigma_deg: FloatArray | None


@dataclass(frozen=True)
class _Definition:
    """joints: names of the points that `formula` takes as (..., P, 3) and turns into radians.
    wraps: whether the angle goes round, and is unwrapped over time."""

    joints: tuple[str, ...]
    formula: Formula
    wraps: bool = False


def angle_at(vertex: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """The angle (...) in degrees at `vertex` between the lines to `first` and `second`.

    All three are (..., 3) in one unit. NaN where a point is missing or a side has no length.
    """
    angle: FloatArray = np.degrees(_between(first - vertex, second - vertex))
    return angle


def angle_names(skeleton: str) -> tuple[str, ...]:
    """The angles that a skeleton can give, in the order in which they are given."""
    places = _places(skeleton)
    return tuple(name for name, d in _DEFINITIONS.items() if set(d.joints) <= places.keys())


def joint_angles(xyz: FloatArray, skeleton: str) -> dict[str, FloatArray]:
    """The angles of a pose or a sequence, each (...) in degrees, by name; not unwrapped.

    Parameters
    ----------
    xyz
        (..., J, 3) joints in any unit, world axes (y up).
    skeleton
        Name of the joints' layout.

    Returns
    -------
    dict
        Angles (...) in degrees by name, see `angle_names`; one that the skeleton cannot give is
        left out.

    Raises
    ------
    UsageError
        For a skeleton that is not known.
    ValueError
        Where J is not its number of joints.

    Examples
    --------
    >>> pose = np.zeros((17, 3))
    >>> sorted(joint_angles(pose, "body17"))[:2]
    ['left_ankle_flexion', 'left_elbow_flexion']
    """
    _check_joints(xyz, skeleton)
    places = _places(skeleton)
    return {
        name: np.degrees(_DEFINITIONS[name].formula(_points(xyz, places, name)))
        for name in angle_names(skeleton)
    }


def track_angles(track: Track3D, *, uncertain: bool = True) -> dict[str, AngleCurve]:
    """The angles of a track over time, unwrapped, with their uncertainty, by name.

    Within a run of frames that have the angle it does not jump by 360°; every run starts between
    -180° and 180°, because turns in a gap are not known. The standard deviation is carried over
    from `track.sigma` (the same in every direction, joints independent of one another) to first
    order; near a pole of the angle that is a lower bound. uncertain: whether it is wanted.
    """
    _check_joints(track.xyz, track.skeleton)
    places = _places(track.skeleton)
    curves = {}
    for name in angle_names(track.skeleton):
        definition = _DEFINITIONS[name]
        points = _points(track.xyz, places, name).astype(np.float64)
        radians = definition.formula(points)
        if definition.wraps:
            radians = _unwrapped(radians)
        sigma = None
        if uncertain and track.sigma is not None:
            columns = [places[joint] for joint in definition.joints]
            sigma = np.degrees(_carried_over(definition.formula, points, columns, track.sigma))
        curves[name] = AngleCurve(name, np.degrees(radians), sigma)
    return curves


def _check_joints(xyz: FloatArray, skeleton: str) -> None:
    joints = len(get(skeleton))
    if xyz.shape[-2:] != (joints, 3):
        raise ValueError(f"xyz has shape {xyz.shape}, expected (..., {joints}, 3)")


def _places(skeleton: str) -> dict[str, int]:
    """Index by the name that the definitions use."""
    return {_SAME_PLACE.get(name, name): i for i, name in enumerate(get(skeleton).joints)}


def _points(xyz: FloatArray, places: dict[str, int], name: str) -> FloatArray:
    columns = [places[joint] for joint in _DEFINITIONS[name].joints]
    points: FloatArray = xyz[..., columns, :]
    return points


def _unwrapped(radians: FloatArray) -> FloatArray:
    """Without jumps of a whole turn within each run of known values."""
    out = radians.copy()
    known = ~np.isnan(radians)
    edges = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        out[start:stop] = np.unwrap(radians[start:stop])
    return out


def _carried_over(
    formula: Formula, points: FloatArray, columns: list[int], sigma: FloatArray
) -> FloatArray:
    """Standard deviation (T,) of a formula of points (T, P, 3), which are the joints `columns` of
    sigma (T, J). A joint may be several of the points: they move together."""
    extent = np.linalg.norm(points - points[:, :1], axis=-1).max(axis=1)
    step = _STEP * np.where(extent > 0, extent, np.nan)
    variance = np.zeros(len(points))
    for joint in set(columns):
        same = [p for p, column in enumerate(columns) if column == joint]
        for axis in range(3):
            ahead, behind = points.copy(), points.copy()
            ahead[:, same, axis] += step[:, None]
            behind[:, same, axis] -= step[:, None]
            change = formula(ahead) - formula(behind)
            slope = (change + np.pi) % (2 * np.pi) - np.pi
            variance += (slope / (2 * step) * sigma[:, joint]) ** 2
    return np.sqrt(variance)


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


def _flexion_of_hinge(p: FloatArray) -> FloatArray:
    """Of a knee or elbow: how far it is from straight."""
    return np.pi - _between(p[..., 0, :] - p[..., 1, :], p[..., 2, :] - p[..., 1, :])


def _dorsiflexion(p: FloatArray) -> FloatArray:
    """Of the ankle: 0 where the line to the big toe is square to the shin."""
    return np.pi / 2 - _between(p[..., 0, :] - p[..., 1, :], p[..., 2, :] - p[..., 1, :])


def _hip_axes(p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
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


def _of_both_sides() -> dict[str, _Definition]:
    found: dict[str, _Definition] = {}
    for kind in _LIMB_ANGLES:
        for side, outwards in (("left", -1), ("right", 1)):
            found[f"{side}_{kind}"] = _limb_angle(kind, side, outwards)
    return found


_LIMB_ANGLES = (
    *("elbow_flexion", "shoulder_flexion", "shoulder_abduction", "shoulder_elevation"),
    *("shoulder_rotation", "hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion"),
    "ankle_flexion",
)


def _limb_angle(kind: str, side: str, outwards: int) -> _Definition:
    trunk = ("pelvis", "neck")
    arm = tuple(f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist"))
    leg = tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle"))
    at_shoulders = (*trunk, "left_shoulder", "right_shoulder")
    at_hips = (*trunk, "left_hip", "right_hip")
    match kind:
        case "elbow_flexion":
            return _Definition(arm, _flexion_of_hinge)
        case "knee_flexion":
            return _Definition(leg, _flexion_of_hinge)
        case "ankle_flexion":
            return _Definition((*leg[1:], f"{side}_toe"), _dorsiflexion)
        case "shoulder_elevation":
            return _Definition((*trunk, *arm[:2]), _elevation)
        case "shoulder_flexion":
            return _Definition((*at_shoulders, *arm[:2]), _flexion(_shoulder_axes), wraps=True)
        case "shoulder_abduction":
            return _Definition((*at_shoulders, *arm[:2]), _abduction(_shoulder_axes, outwards))
        case "shoulder_rotation":
            turn = _rotation(_shoulder_axes, outwards, bends=1)
            return _Definition((*at_shoulders, *arm), turn, wraps=True)
        case "hip_flexion":
            return _Definition((*at_hips, *leg[:2]), _flexion(_hip_axes), wraps=True)
        case "hip_abduction":
            return _Definition((*at_hips, *leg[:2]), _abduction(_hip_axes, outwards))
        case _:
            turn = _rotation(_hip_axes, outwards, bends=-1)
            return _Definition((*at_hips, *leg), turn, wraps=True)


_DEFINITIONS = {
    **_of_both_sides(),
    "trunk_lean": _Definition(("pelvis", "neck"), _lean),
    "trunk_lean_forward": _Definition(
        ("pelvis", "neck", "left_hip", "right_hip"), _lean_towards(forward=True), wraps=True
    ),
    "trunk_lean_right": _Definition(
        ("pelvis", "neck", "left_hip", "right_hip"), _lean_towards(forward=False), wraps=True
    ),
    "trunk_rotation": _Definition(
        ("pelvis", "neck", "left_hip", "right_hip", "left_shoulder", "right_shoulder"),
        _trunk_rotation,
        wraps=True,
    ),
}
ANGLES = tuple(_DEFINITIONS)


def pelvis_rotation(track: Track3D) -> FloatArray:
    """(T, 3) degrees: tilt, list and rotation of the hips in the world, as OpenSim has them.

    The turns of the hips' axes (forward, up, right) about the world's z, the new x and the new y
    axis, in this order, after standing with the right side at +z; unwrapped.
    """
    places = _places(track.skeleton)
    points = track.xyz[:, [places[name] for name in ("pelvis", "neck", "left_hip", "right_hip")]]
    axes = np.stack(_hip_axes(points.astype(np.float64)), axis=-1)
    out = np.full((len(axes), 3), np.nan)
    known = ~np.isnan(axes).any(axis=(1, 2))
    if known.any():
        out[known] = Rotation.from_matrix(axes[known]).as_euler("ZXY")
    return np.degrees(np.stack([_unwrapped(out[:, i]) for i in range(3)], axis=1))
