"""Skeletons as data: names, bones, mirror images, and the mappings between them.

Two families. Keypoint skeletons (coco17, halpe26, ...) are what 2D models emit, in their
publishers' order and names. Lifting skeletons (cmu17, paper15, body17) are trees rooted at the
pelvis in which 3D poses live. `cmu17` has the joints of Akhter & Black (CVPR 2015) as the CMU rig
places them; `paper15` is the same without toes, in the order of the paper's tables; `body17` has
cmu17's tree with pelvis, neck and head where keypoint models see them (midpoints of hips,
shoulders and ears). The tables are in `skeleton_tables`.
"""

from __future__ import annotations

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.poses import FloatArray
from dance2pose.skeleton_tables.keypoints import BODIES
from dance2pose.skeleton_tables.mappings import MAPPINGS
from dance2pose.skeleton_tables.mappings import SKELETONS_BY_COUNT as SKELETONS_BY_COUNT
from dance2pose.skeleton_tables.model import Skeleton as Skeleton
from dance2pose.skeleton_tables.trees import TREES
from dance2pose.skeleton_tables.whole_body import FIRST_OF_FACE, WHOLE_BODIES

_BY_NAME = {skeleton.name: skeleton for skeleton in (*TREES, *BODIES, *WHOLE_BODIES)}


def names() -> tuple[str, ...]:
    """The names of all skeletons."""
    return tuple(_BY_NAME)


def get(name: str) -> Skeleton:
    """The skeleton of that name; UsageError lists the known ones."""
    try:
        return _BY_NAME[name]
    except KeyError:
        raise UsageError(f"unknown skeleton {name!r}; known: {', '.join(_BY_NAME)}") from None


def lifting_skeleton(name: str) -> Skeleton:
    """The skeleton in which poses of skeleton `name` are lifted: itself if a tree, else body17."""
    skeleton = get(name)
    return skeleton if skeleton.is_tree else _BY_NAME["body17"]


def body_keypoints(name: str) -> list[int]:
    """Indices of a skeleton's keypoints without the face and hands that whole-body ones append.

    Those outnumber the body four to one and are often unseen: what tells people apart, or says how
    well somebody is seen, asks the body alone.
    """
    joints = get(name).joints
    end = joints.index(FIRST_OF_FACE) if FIRST_OF_FACE in joints else len(joints)
    return list(range(end))


def convert(
    values: FloatArray, confidence: FloatArray, *, source: str, target: str
) -> tuple[FloatArray, FloatArray]:
    """Points of one skeleton as points of another, by name and by the stated midpoints.

    values: (..., J_source, D); confidence: (..., J_source). Returns (..., J_target, D) and
    (..., J_target): a joint made of several keypoints is their mean and as sure as the least
    sure of them; one that the source does not have, or has as NaN, is NaN with confidence 0.
    """
    if source == target:
        return values, confidence
    from_skeleton, to_skeleton = get(source), get(target)
    special = MAPPINGS.get((source, target), {})
    out = np.full((*values.shape[:-2], len(to_skeleton), values.shape[-1]), np.nan, values.dtype)
    out_confidence = np.zeros((*confidence.shape[:-1], len(to_skeleton)), confidence.dtype)
    for j, joint in enumerate(to_skeleton.joints):
        parts = special.get(joint, (joint,))
        if not all(part in from_skeleton.joints for part in parts):
            continue
        columns = [from_skeleton.joints.index(part) for part in parts]
        out[..., j, :] = values[..., columns, :].mean(axis=-2)
        out_confidence[..., j] = confidence[..., columns].min(axis=-1)
    out_confidence[np.isnan(out).any(axis=-1)] = 0
    return out, out_confidence
