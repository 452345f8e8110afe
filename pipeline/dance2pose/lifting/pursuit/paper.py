"""The paper's lifter: every frame alone, by pursuit over the dictionary within the limits.

Nguyen, Ngo, Le, section 3: R12's pursuit and weak-perspective camera, with AB15's rule that an
atom after which a joint would bend as no joint can is passed over. Nothing flows between frames;
the temporal models follow as a stage of their own.

Three things go beyond the papers' text, because they were measured to be better on takes held out
of training (models/README.md has the figures): several first rotations (`pursuit`), bone lengths
held by scaling pose against camera rather than in the coefficients, and exact bone lengths at the
end (`bone_depths`). `PursuitSettings` and `exact_bones` turn each of them off.
"""

from __future__ import annotations

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import UsageError
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit import dictionary
from dance2pose.lifting.pursuit.bone_depths import with_exact_depths
from dance2pose.lifting.pursuit.camera import centred
from dance2pose.lifting.pursuit.dictionary import Dictionary
from dance2pose.lifting.pursuit.pursue import PoseLimits, PursuitSettings, pursue
from dance2pose.limits import model as limits
from dance2pose.poses import FloatArray

# Rotation, scale and place of the camera are six numbers, two joints give four: with fewer than
# this nothing can be said of the pose.
FEWEST_JOINTS = 4


def lift_frames(
    observed: Observed,
    *,
    settings: PursuitSettings | None = None,
    limited: bool = True,
    exact_bones: bool = True,
) -> Lifted:
    """Poses of all frames with at least FEWEST_JOINTS joints seen; the others stay NaN.

    limited: pass over atoms after which a joint would bend as no joint can; False is an ablation.
    exact_bones: end with the body's bone lengths; False leaves the pursuit's own pose.
    """
    if observed.camera != "weak-perspective":
        raise UsageError(
            f"the paper's lifter knows no {observed.camera} camera; use the default lifter for it"
        )
    weights = keypoint_weights(observed.xy, observed.confidence)
    frames, joints = weights.shape
    known = (weights > 0).sum(axis=1) >= FEWEST_JOINTS
    xyz = np.full((frames, joints, 3), np.nan)
    projected = np.full((frames, joints, 2), np.nan)
    if known.any():
        xyz[known], projected[known] = lift_points(
            observed.xy[known],
            weights[known],
            dictionary.load(observed.skeleton),
            limits.load(observed.skeleton) if limited else None,
            settings=settings,
            exact_bones=exact_bones,
        )
    return Lifted(xyz, projected)


def lift_points(
    xy: FloatArray,
    weights: FloatArray,
    poses: Dictionary,
    limits: PoseLimits | None,
    *,
    settings: PursuitSettings | None = None,
    exact_bones: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Poses (N, J, 3) mm, first joint at the origin, and their image (N, J, 2) in the unit of xy.

    xy: (N, J, 2), y up, may be NaN where weights (N, J) are 0; FEWEST_JOINTS or more are not.
    """
    points = np.concatenate([xy, np.zeros((*weights.shape, 1))], axis=2)
    planar = np.repeat(weights[..., None], 3, axis=2)
    planar[..., 2] = 0.0
    found = pursue(poses, points, planar, settings=settings, limits=limits)
    xyz, camera = found.xyz, found.camera
    if exact_bones:
        seen = weights > 0
        offset = np.where(seen[..., None], xy - camera.translation[:, None, :2], 0.0)
        xyz = with_exact_depths(
            xyz,
            offset / camera.scale[:, None, None],
            seen,
            found.residual / camera.scale,
            skeletons.get(poses.skeleton),
            poses.bone_lengths,
            limits,
        )
    drawn = camera.scale[:, None, None] * xyz[..., :2]
    flat = planar[..., :2]
    shift = centred(np.where(flat > 0, xy, 0.0), flat)[1] - centred(drawn, flat)[1]
    return xyz, drawn + shift[:, None]


def keypoint_weights(xy: FloatArray, confidence: FloatArray) -> FloatArray:
    """Weights (T, J) in 0..1 from confidences of any scale: 1 for what the model is surest of.

    Confidences of different models are not comparable, so they are taken relative to the 90th
    percentile of this track's own. 0 where a joint was not seen.
    """
    seen = np.isfinite(xy).all(axis=-1) & (confidence > 0)
    if not seen.any():
        return np.zeros(confidence.shape)
    surest = np.quantile(confidence[seen], 0.9)
    weights: FloatArray = np.where(seen, np.clip(confidence / surest, 0.0, 1.0), 0.0)
    return weights
