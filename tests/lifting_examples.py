"""Made-up poses to lift, and how far from them a result is."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.body import body_bones_mm, retarget
from dance2pose.lifting.pursuit import dictionary
from dance2pose.lifting.pursuit.alignment import similarity
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get


def pa_mpjpe(found: FloatArray, truth: FloatArray) -> float:
    """mm, after similarity alignment without reflection."""
    rotation, scale = similarity(found, truth)
    aligned = (
        scale[:, None, None] * (found - found.mean(1, keepdims=True)) @ np.swapaxes(rotation, 1, 2)
    )
    left = aligned - (truth - truth.mean(1, keepdims=True))
    return float(np.linalg.norm(left, axis=-1).mean())


def posed(skeleton: str, frames: int = 7, seed: int = 0) -> FloatArray:
    """Poses of a few atoms each (frames, J, 3), mm on the one body, seen from all around."""
    poses = dictionary.load(skeleton)
    rng = np.random.default_rng(seed)
    active = np.array([rng.choice(len(poses), 3, replace=False) for _ in range(frames)])
    body = poses.pose(active, rng.normal(size=(frames, 3)) * 150)
    turn = Rotation.from_euler("y", rng.uniform(0, 360, (frames, 1)), degrees=True).as_matrix()
    turned = body @ turn.transpose(0, 2, 1)
    return retarget(turned, get(skeleton), body_bones_mm(skeleton))
