"""The paper's lifter: every frame alone, by pursuit over the dictionary within the limits.

Nguyen, Ngo, Le, section 3: R12's pursuit and weak-perspective camera, with AB15's rule that an
atom after which a joint would bend as no joint can is passed over. Nothing flows between frames;
the temporal models follow as a stage of their own.
"""

from __future__ import annotations

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.lifting import dictionary, limits
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit import PursuitSettings, pursue
from dance2pose.poses import FloatArray

# Rotation, scale and place of the camera are six numbers, two joints give four: with fewer than
# this nothing can be said of the pose.
FEWEST_JOINTS = 4


def lift_frames(
    observed: Observed, *, settings: PursuitSettings | None = None, limited: bool = True
) -> Lifted:
    """Poses of all frames with at least FEWEST_JOINTS joints seen; the others stay NaN.

    limited: pass over atoms after which a joint would bend as no joint can; False is an ablation.
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
        points = np.concatenate([observed.xy, np.zeros((frames, joints, 1))], axis=2)[known]
        planar = np.repeat(weights[known, :, None], 3, axis=2)
        planar[..., 2] = 0.0
        found = pursue(
            dictionary.load(observed.skeleton),
            points,
            planar,
            settings=settings,
            limits=limits.load(observed.skeleton) if limited else None,
        )
        xyz[known] = found.xyz
        projected[known] = found.camera.project(found.body)[..., :2]
    return Lifted(xyz, projected)


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
