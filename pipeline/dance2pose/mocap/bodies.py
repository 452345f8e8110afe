"""Bodies as people have them: bone lengths drawn from human variation.

All bodies of one skeleton have the same sum of bone lengths, so that errors in mm compare.
"""

from __future__ import annotations

import numpy as np

from dance2pose.body import body_bones_mm
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

# Standard deviation of the logarithm of each bone's length beside the others of the same body, in
# the order of cmu17's and body17's bones: trunk, shoulder, upper arm, forearm, head, hip, thigh,
# shin, foot. The segments of adults vary by 4 to 6 % of their length and breadths by 5 to 7 %
# (coefficients of variation of ANSUR II, Gordon et al. 2014), about two thirds of it with stature;
# what is left is widened here, since people also differ in where a rig or a keypoint model sees
# their joints: the nine CMU performers differ by 4 to 8 % in trunk, shoulders, hips and head.
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
_TOGETHER = 0.4
# Left and right bones of one body differ by about this part (of nine CMU performers: 0.03).
SIDES_SPREAD = 0.015
_LIMBS = ([2, 3, 5, 6], [9, 10, 13, 14])  # upper arms and forearms, thighs and shins


def variations(
    rng: np.random.Generator, count: int, *, sides: FloatArray | float = SIDES_SPREAD
) -> FloatArray:
    """Factors (count, J - 1) by which the bones of `count` people differ from a mean body's.

    For cmu17 and body17, whose bones come in the same order. sides: standard deviation of the
    difference between each bone and its counterpart, as a part of it, one number or (count, 1).
    """
    mirror = np.array(get("cmu17").mirror[1:]) - 1
    own = rng.standard_normal((count, len(SPREAD)))
    own = np.where(np.arange(len(SPREAD)) <= mirror, own, own[:, mirror])  # left as right
    for limb in _LIMBS:
        common = rng.standard_normal((count, 1))
        own[:, limb] = np.sqrt(1 - _TOGETHER) * own[:, limb] + np.sqrt(_TOGETHER) * common
    uneven = rng.standard_normal((count, len(SPREAD))) * sides / 2
    uneven = uneven - uneven[:, mirror]
    return np.asarray(np.exp(own * SPREAD + uneven / np.sqrt(2)))


def drawn_bodies(rng: np.random.Generator, count: int, skeleton: str) -> FloatArray:
    """Bone lengths (count, J - 1) mm of people about the one body of a lifting skeleton."""
    return of_one_size(body_bones_mm(skeleton) * variations(rng, count), skeleton)


def of_one_size(lengths: FloatArray, skeleton: str) -> FloatArray:
    """Bone lengths (..., J - 1) scaled to the sum that the one body's have."""
    whole = body_bones_mm(skeleton).sum()
    return np.asarray(lengths * (whole / lengths.sum(axis=-1, keepdims=True)))
