"""How large a dancer looks, frame by frame: what comes nearer grows.

N frames, J joints of a lifting skeleton; sizes are relative to the one body of `mocap.corpus`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dance2pose.lifting.temporal.smoothness import smooth_path
from dance2pose.poses import FloatArray, IntArray
from dance2pose.skeleton import Skeleton

# Errors of the sizes that the network's poses have, as a part of them, where it is as sure of its
# joints as it usually is (held-out takes: 0.014 to 0.018). They grow with the square of its doubt:
# where joints are missing sizes err more than poses.
SIZE_ERROR, _USUAL_SIGMA_MM = 0.02, 40.0
# Changes of size over this many seconds are the dancer's way towards the camera, quicker ones are
# errors. Longer means miss the way: 0.5 s leaves errors of 0.018, 1.5 s of 0.030.
_SIZE_S = 0.4


def sizes(xyz: FloatArray, skeleton: Skeleton, body_mm: FloatArray) -> FloatArray:
    """How large (N,) the bodies of poses (N, J, 3) are.

    All bones together, but never less than the bones that look longest say: no bone looks longer
    than it is.
    """
    parents, children = np.array(skeleton.bones).T
    bones = xyz[:, children] - xyz[:, parents]
    whole = np.linalg.norm(bones, axis=-1).sum(axis=1) / body_mm.sum()
    flat = np.linalg.norm(bones[..., :2], axis=-1) / body_mm
    return np.asarray(np.maximum(whole, np.sort(flat, axis=1)[:, -3:].mean(axis=1)))


def growth(
    size: FloatArray, sigma: FloatArray, parts: Sequence[IntArray], time_s: FloatArray
) -> FloatArray:
    """How the figure grows and shrinks (N,), about 1: the sizes (N,) without their errors.

    sigma: (N, J) mm of the poses. parts: rows that follow each other in time.
    """
    error = np.maximum(sigma.mean(axis=1) / _USUAL_SIGMA_MM, 1.0) ** 2
    grown = np.log(size)
    for part in parts:
        grown[part] = smooth_path(
            grown[part], error[part], time_s[part], acceleration=1 / _SIZE_S**2
        )
    grown -= np.median(grown)
    noise = float(np.median(SIZE_ERROR * error)) ** 2
    real = max(0.0, 1.0 - noise / max(float(np.mean(grown**2)), 1e-12))
    return np.asarray(np.exp(real * grown))
