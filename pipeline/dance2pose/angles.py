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

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.angle_formulas import DEFINITIONS, Formula, hip_axes
from dance2pose.holes import unbroken
from dance2pose.poses import FloatArray, Track3D
from dance2pose.skeleton import get

# The same place under the names of cmu17.
_SAME_PLACE = {"root": "pelvis", "upper_back": "neck"}
# Step of the numerical derivative, as a share of the distance between the joints of an angle.
_STEP = 1e-5


@dataclass(frozen=True)
class AngleCurve:
    """An angle over time: degrees (T,), NaN where it is not defined or a joint is missing, and
    sigma_deg (T,), its standard deviation, or None where the lifter gives no uncertainty."""

    name: str
    degrees: FloatArray
    sigma_deg: FloatArray | None


def angle_names(skeleton: str) -> tuple[str, ...]:
    """The angles that a skeleton can give, in the order in which they are given."""
    index = _joint_index(skeleton)
    return tuple(name for name, d in DEFINITIONS.items() if set(d.joints) <= index.keys())


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
    index = _joint_index(skeleton)
    return {
        name: np.degrees(DEFINITIONS[name].formula(_points(xyz, index, name)))
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
    index = _joint_index(track.skeleton)
    curves = {}
    for name in angle_names(track.skeleton):
        definition = DEFINITIONS[name]
        points = _points(track.xyz, index, name).astype(np.float64)
        radians = definition.formula(points)
        if definition.wraps:
            radians = _unwrapped(radians)
        sigma = None
        if uncertain and track.sigma is not None:
            columns = [index[joint] for joint in definition.joints]
            sigma = np.degrees(_carried_over(definition.formula, points, columns, track.sigma))
        curves[name] = AngleCurve(name, np.degrees(radians), sigma)
    return curves


def _check_joints(xyz: FloatArray, skeleton: str) -> None:
    joints = len(get(skeleton))
    if xyz.shape[-2:] != (joints, 3):
        raise ValueError(f"xyz has shape {xyz.shape}, expected (..., {joints}, 3)")


def _joint_index(skeleton: str) -> dict[str, int]:
    """Index by the name that the definitions use."""
    return {_SAME_PLACE.get(name, name): i for i, name in enumerate(get(skeleton).joints)}


def _points(xyz: FloatArray, index: dict[str, int], name: str) -> FloatArray:
    columns = [index[joint] for joint in DEFINITIONS[name].joints]
    points: FloatArray = xyz[..., columns, :]
    return points


def _unwrapped(radians: FloatArray) -> FloatArray:
    """Without jumps of a whole turn within each run of known values."""
    out = radians.copy()
    known = ~np.isnan(radians)
    for run in unbroken(known):
        out[run] = np.unwrap(radians[run])
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


def pelvis_rotation(track: Track3D) -> FloatArray:
    """(T, 3) degrees: tilt, list and rotation of the hips in the world, as OpenSim has them.

    The turns of the hips' axes (forward, up, right) about the world's z, the new x and the new y
    axis, in this order, after standing with the right side at +z; unwrapped.
    """
    index = _joint_index(track.skeleton)
    points = track.xyz[:, [index[name] for name in ("pelvis", "neck", "left_hip", "right_hip")]]
    axes = np.stack(hip_axes(points.astype(np.float64)), axis=-1)
    out = np.full((len(axes), 3), np.nan)
    known = ~np.isnan(axes).any(axis=(1, 2))
    if known.any():
        out[known] = Rotation.from_matrix(axes[known]).as_euler("ZXY")
    return np.degrees(np.stack([_unwrapped(out[:, i]) for i in range(3)], axis=1))
