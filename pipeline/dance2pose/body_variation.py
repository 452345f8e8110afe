"""How people's bones vary: what is known of a body before it is seen.

Standard deviations of the logarithm of each bone's length beside the others of the same body. The
segments of adults vary by 4 to 6 % of their length and breadths by 5 to 7 % (coefficients of
variation of ANSUR II, Gordon et al. 2014), about two thirds of it with stature; what is left is
widened here, since people also differ in where a rig or a keypoint model sees their joints: nine
performers of the CMU database differ by 4 to 8 % in trunk, shoulders, hips and head.

Bones come in the order of cmu17 and body17, whose trees are the same.
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

_TRUNK, _SHOULDER, _ARM, _FOREARM, _HEAD = 0.05, 0.06, 0.045, 0.055, 0.08
_HIP, _THIGH, _SHIN, _FOOT = 0.10, 0.045, 0.045, 0.07
SPREAD: FloatArray = np.array(
    [
        _TRUNK,
        *(_SHOULDER, _ARM, _FOREARM) * 2,
        _HEAD,
        *(_HIP, _THIGH, _SHIN, _FOOT) * 2,
    ]
)
# Limbs are long or short together: this part of an arm's or leg's variance is common to its bones.
TOGETHER = 0.4
LIMBS = ([2, 3, 5, 6], [9, 10, 13, 14])  # upper arms and forearms, thighs and shins
# Left and right bones of one body differ by about this part (of nine CMU performers: 0.03).
SIDES_SPREAD = 0.015


def log_covariance() -> FloatArray:
    """(J - 1, J - 1) covariance of the logarithms of bone lengths among people."""
    mirror = np.array(get("cmu17").mirror[1:]) - 1
    bones = np.arange(len(SPREAD))
    together = np.eye(len(SPREAD))
    together[bones, mirror] = 1.0
    for limb in LIMBS:
        same = np.equal.outer(np.minimum(bones, mirror), np.minimum(bones, mirror))[
            np.ix_(limb, limb)
        ]
        together[np.ix_(limb, limb)] = np.where(same, 1.0, TOGETHER)
    covariance = together * np.outer(SPREAD, SPREAD)
    paired = bones != mirror
    covariance[bones[paired], bones[paired]] += SIDES_SPREAD**2 / 4
    covariance[bones[paired], mirror[paired]] -= SIDES_SPREAD**2 / 4
    return np.asarray(covariance)
