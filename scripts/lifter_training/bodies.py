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
# Bones of each limb, and how far it is turned at the shoulder or hip, degrees about each axis: in
# most clips as postures differ, in some as a leg is lifted.
_TURNED, _TURNS = 0.25, (([2, 3], 18), ([5, 6], 18), ([9, 10, 11], 8), ([13, 14, 15], 8))
_LIFTED, _LIFTS = 0.25, 25
# Share of clips in which a limb (upper bone, lower bones) is stretched, and of their limbs.
_STRETCHED, _LIMB_STRETCHED = 0.12, 0.4
_STRETCHES = ((2, [3]), (5, [6]), (9, [10, 11]), (13, [14, 15]))


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
    """Bones (B, T, J - 1, 3) with arms and legs of one clip in four turned whole, at shoulder and
    hip, each about an axis of its own and alike in all frames: poses that no take has."""
    some = np.flatnonzero(rng.random(len(bones)) < _TURNED)
    out = bones.copy()
    lifted = rng.random(len(some)) < _LIFTED
    for limb, degrees in _TURNS:
        most = np.where(lifted, max(degrees, _LIFTS), degrees)
        turn = rng.standard_normal((len(some), 3)) * np.radians(most)[:, None]
        matrix = Rotation.from_rotvec(turn).as_matrix().astype(np.float32)
        out[np.ix_(some, np.arange(bones.shape[1]), limb)] = _turned(
            bones[some][:, :, limb], matrix
        )
    return out


def limbs_stretched(bones: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Bones (B, T, J - 1, 3) with some limbs of some clips nearly or wholly straight.

    The lower bones turn towards the upper one by the same part of the bend in all frames: raised
    straight legs and stretched arms, which dances have more of than the takes.
    """
    out = bones.copy()
    chosen = rng.random(len(bones)) < _STRETCHED
    for upper, lower in _STRETCHES:
        some = np.flatnonzero(chosen & (rng.random(len(bones)) < _LIMB_STRETCHED))
        part = rng.choice([0.5, 0.8, 0.95, 1.0], (len(some), 1, 1))
        first, second = (_directions(bones[some][:, :, bone]) for bone in (upper, lower[0]))
        axis = np.cross(second, first)
        sine = np.linalg.norm(axis, axis=-1, keepdims=True)
        bend = np.arctan2(sine, (first * second).sum(axis=-1, keepdims=True))
        # Near a whole fold the way back has no one direction; such limbs stay.
        turn = np.where(bend < 2.8, part * bend, 0.0) * axis / np.maximum(sine, 1e-6)
        matrix = Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().astype(np.float32)
        matrix = matrix.reshape(*turn.shape[:2], 3, 3)
        moved = np.einsum("btij,btkj->btki", matrix, bones[some][:, :, lower])
        out[np.ix_(some, np.arange(bones.shape[1]), lower)] = moved
    return out


def _directions(bones: FloatArray) -> FloatArray:
    return np.asarray(bones / np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-6))


def _turned(bones: FloatArray, matrix: FloatArray) -> FloatArray:
    """Bones (B, T, K, 3) turned by one matrix (B, 3, 3) a clip."""
    return np.asarray((bones.reshape(len(bones), -1, 3) @ matrix.mT).reshape(bones.shape))


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
