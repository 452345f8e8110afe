"""Bodies as people have them: bone lengths drawn from human variation.

All bodies of one skeleton have the same sum of bone lengths, so that errors in mm compare.
"""

from __future__ import annotations

import numpy as np

from dance2pose.body import body_bones_mm
from dance2pose.body_variation import LIMBS, SIDES_SPREAD, SPREAD, TOGETHER
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get


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
    for limb in LIMBS:
        common = rng.standard_normal((count, 1))
        own[:, limb] = np.sqrt(1 - TOGETHER) * own[:, limb] + np.sqrt(TOGETHER) * common
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
