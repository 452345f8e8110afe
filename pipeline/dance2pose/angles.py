"""Joint angles of a skeleton: how far elbows, knees, shoulders and hips are open.

An angle here is the one at a joint between the lines to two other joints, in degrees from 0 to
180, and needs no reference pose: a straight arm has an elbow of 180°, an arm along the body a
shoulder of about 0°, a straight hip 180°.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

# The joint, and the two joints that the sides of its angle point to.
_SIDES = {
    "elbow": ("shoulder", "wrist"),
    "shoulder": ("elbow", "hip"),
    "hip": ("shoulder", "knee"),
    "knee": ("hip", "ankle"),
}
ANGLE_JOINTS = tuple(f"{side}_{joint}" for joint in _SIDES for side in ("left", "right"))


def angle_at(vertex: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """The angle (...) in degrees at `vertex` between the lines to `first` and `second`.

    All three are (..., 3) in one unit. NaN where a point is missing or a side has no length.
    """
    u, v = first - vertex, second - vertex
    # The two-argument arctangent stays exact near 0° and 180°, where the arccosine does not.
    across = np.linalg.norm(np.cross(u, v), axis=-1)
    along = (u * v).sum(axis=-1)
    angle: FloatArray = np.degrees(np.arctan2(across, along))
    no_length = (np.linalg.norm(u, axis=-1) == 0) | (np.linalg.norm(v, axis=-1) == 0)
    return np.where(no_length, np.nan, angle)


def joint_angles(xyz: FloatArray, skeleton: str) -> dict[str, FloatArray]:
    """The angles of elbows, shoulders, hips and knees, each (...) in degrees.

    xyz: (..., J, 3) in any unit. A joint whose angle the skeleton cannot give is left out. Raises
    UsageError for a skeleton that is not known and ValueError where J is not its joint count.
    """
    joints = get(skeleton).joints
    if xyz.shape[-2:] != (len(joints), 3):
        raise ValueError(f"xyz has shape {xyz.shape}, expected (..., {len(joints)}, 3)")
    angles = {}
    for name in ANGLE_JOINTS:
        side, joint = name.split("_")
        points = [name, *(f"{side}_{end}" for end in _SIDES[joint])]
        if all(point in joints for point in points):
            vertex, first, second = (xyz[..., joints.index(point), :] for point in points)
            angles[name] = angle_at(vertex, first, second)
    return angles
