"""The bodies of training views: performers' own, other performers', and people's in general."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal.network import JOINTS
from dance2pose.mocap.bodies import drawn_bodies, of_one_size, variations
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import get
from lifter_training.takes import Clips, TakeStore

_SKELETON = get("cmu17")
_MIRROR = np.array(_SKELETON.mirror)
_SKELETONS = ("cmu17", "body17")
# Bones of each limb, and how far it is turned at the shoulder or hip, degrees about each axis.
_TURNED, _TURNS = 0.2, (([2, 3], 18), ([5, 6], 18), ([9, 10, 11], 8), ([13, 14, 15], 8))


def _path_matrix() -> FloatArray:
    """(J, J - 1): which bones lead from the root to a joint."""
    path = np.zeros((JOINTS, JOINTS - 1))
    for bone, (parent, child) in enumerate(_SKELETON.bones):
        path[child] = path[parent]
        path[child, bone] = 1
    return path


_PATH = _path_matrix().astype(np.float32)


def bodies(
    store: TakeStore, clips: Clips, body17: BoolArray, rng: np.random.Generator, which: str
) -> FloatArray:
    """Bone lengths (B, J - 1) mm for clips, all of one sum. which: as `views.Mixture.body`."""
    count, kind = len(body17), body17.astype(int)
    one = np.array([body_bones_mm(s) for s in _SKELETONS])[kind]
    own = store.lengths[kind, clips.take]
    if which == "one":
        lengths = one
    elif which == "own":
        lengths = own
    elif which == "drawn":
        both = np.stack([drawn_bodies(rng, count, s) for s in _SKELETONS])
        lengths = both[kind, np.arange(count)]
    else:
        lengths = _mixed(store, one, own, kind, rng)
    return np.where(body17[:, None], of_one_size(lengths, "body17"), of_one_size(lengths, "cmu17"))


def _mixed(
    store: TakeStore, one: FloatArray, own: FloatArray, kind: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """A third of the bodies start from the performer's own, a third from the one body, a third
    from a mixture of two other performers'; three quarters of all then vary as people do."""
    count = len(own)
    first, second = rng.choice(store.of_performer, (2, count))
    part = rng.uniform(-0.25, 1.25, (count, 1)) * (rng.random((count, 1)) < 0.6)
    other = store.lengths[kind, first] ** (1 - part) * store.lengths[kind, second] ** part
    start = rng.random((count, 1))
    lengths = np.where(start < 0.33, own, np.where(start < 0.66, one, other))
    sides = rng.choice([0.0, 0.015, 0.03], (count, 1))
    strength = np.where(rng.random((count, 1)) < 0.25, 0.0, rng.uniform(0.3, 1.5, (count, 1)))
    return np.asarray(lengths * variations(rng, count, sides=sides) ** strength)


def limbs_turned(bones: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Bones (B, T, J - 1, 3) with arms and legs of one clip in five turned whole, at shoulder and
    hip, each about an axis of its own and alike in all frames: poses that no take has."""
    some = np.flatnonzero(rng.random(len(bones)) < _TURNED)
    out = bones.copy()
    for limb, degrees in _TURNS:
        turn = rng.standard_normal((len(some), 3)) * np.radians(degrees)
        matrix = Rotation.from_rotvec(turn).as_matrix().astype(np.float32)
        part = bones[some][:, :, limb]
        out[np.ix_(some, np.arange(bones.shape[1]), limb)] = (
            part.reshape(len(some), -1, 3) @ matrix.mT
        ).reshape(part.shape)
    return out


def posed(bones: FloatArray, lengths: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Poses (B, T, J, 3) of these bones (B, T, J - 1, 3) with lengths (B, J - 1), half mirrored.

    Those mirrored get their lengths mirrored too, in place.
    """
    now = np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-6)
    out = np.matmul(_PATH, bones * (lengths[:, None, :, None].astype(np.float32) / now))
    flip = rng.random(len(bones)) < 0.5
    out[flip] = out[flip][:, :, _MIRROR] * np.array([-1, 1, 1], np.float32)
    lengths[flip] = lengths[flip][:, _MIRROR[1:] - 1]
    return np.asarray(out)
