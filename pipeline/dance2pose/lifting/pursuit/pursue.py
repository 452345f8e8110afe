"""Orthogonal matching pursuit of poses over a dictionary, with the camera, batched over frames.

Ramakrishna, Kanade, Sheikh (ECCV 2012; "R12"), eq. 2-4 of the paper: minimise
|x - s (I x R)(mean + sum w_i atom_i)|^2 over a small active set of atoms, its coefficients w, the
rotation R and the scale s of a weak-perspective camera. Every frame has its own; all frames take
their steps together, and those that are done drop out.

Observations are (N, J, 3): x right, y up, and depth z towards the viewer in the same unit where
something else tells it. Each coordinate has its own weight, 0 where it was not observed. The image
may lie anywhere and be of any size: translation is free along every axis.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
from threadpoolctl import ThreadpoolController

from dance2pose.lifting.pursuit.camera import WeakPerspective, rotation_from_vector
from dance2pose.lifting.pursuit.dictionary import Dictionary
from dance2pose.lifting.pursuit.greedy import Frames, PoseLimits, Pursuit, PursuitSettings
from dance2pose.poses import FloatArray

__all__ = ["PoseLimits", "Pursuit", "PursuitSettings", "pursue"]

# Frames worked on together: enough to hide what a call of NumPy costs, few enough for every core to
# have some.
_CHUNK = 512
# Mirrors depth on either side of a rotation, which so stays one.
_DEPTH = np.diag([1.0, 1.0, -1.0])
# Turns of the body that are tried first: none, leaning forward, leaning back (degrees).
_TURNS = rotation_from_vector(np.radians(np.array([[0, 0, 0], [30, 0, 0], [-30, 0, 0]])))
# What a squared error of a bone length counts beside one of the image.
_LENGTHS_MATTER = 0.1


def pursue(
    dictionary: Dictionary,
    observed: FloatArray,
    weights: FloatArray,
    *,
    settings: PursuitSettings | None = None,
    limits: PoseLimits | None = None,
    rotation: FloatArray | None = None,
) -> Pursuit:
    """Poses and cameras of N frames.

    observed: (N, J, 3), may hold NaN where the weight is 0. weights: (N, J, 3), not negative.
    limits: atoms after which a bone that was possible no longer is are passed over (AB15).
    rotation: (N, 3, 3) camera_from_body to start from, instead of the starts in the settings.
    Raises ValueError where shapes, or numbers that count, are not as said.
    """
    settings = settings or PursuitSettings()
    _check(dictionary, observed, weights, rotation)

    def chunk(first: int) -> Pursuit:
        rows = slice(first, first + _CHUNK)
        frames = Frames(dictionary, observed[rows], weights[rows], settings, limits)
        if rotation is not None:
            return frames.run(rotation[rows])
        if settings.start_atoms:
            return frames.run(_best_start(dictionary, observed[rows], weights[rows], settings))
        return frames.run(frames.first_camera().rotation)

    firsts = range(0, max(len(observed), 1), _CHUNK)
    # NumPy lets other threads run while it computes. Its own threads, as many for every call, cost
    # more than they bring: with them two cores do half as many frames.
    cores = min(len(firsts), os.cpu_count() or 1)
    with _blas().limit(limits=1, user_api="blas"), ThreadPoolExecutor(cores) as threads:
        return _joined(list(threads.map(chunk, firsts)))


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()  # looks through the loaded libraries once


def _check(
    dictionary: Dictionary, observed: FloatArray, weights: FloatArray, rotation: FloatArray | None
) -> None:
    wanted = (len(observed), dictionary.joints, 3)
    for name, array in (("observed", observed), ("weights", weights)):
        if array.shape != wanted:
            raise ValueError(f"{name} has shape {array.shape}, expected {wanted}")
    if rotation is not None and rotation.shape != (len(observed), 3, 3):
        raise ValueError(f"rotation has shape {rotation.shape}, expected ({len(observed)}, 3, 3)")
    if not (np.isfinite(weights).all() and (weights >= 0).all()):
        raise ValueError("weights must be finite and not negative")
    if not np.isfinite(observed[weights > 0]).all():
        raise ValueError("observed must be finite where its weight is not 0")


def _joined(parts: list[Pursuit]) -> Pursuit:
    cameras = [p.camera for p in parts]
    return Pursuit(
        np.concatenate([p.body for p in parts]),
        WeakPerspective(
            np.concatenate([c.rotation for c in cameras]),
            np.concatenate([c.scale for c in cameras]),
            np.concatenate([c.translation for c in cameras]),
        ),
        np.concatenate([p.active for p in parts]),
        np.concatenate([p.coefficients for p in parts]),
        np.concatenate([p.growth for p in parts]),
        np.concatenate([p.residual for p in parts]),
    )


def _best_start(
    dictionary: Dictionary, observed: FloatArray, weights: FloatArray, settings: PursuitSettings
) -> FloatArray:
    """The first rotations (N, 3, 3) from which a short pursuit explains the frames best.

    One view leaves depth to be mirrored: a torso leaning to the viewer looks like one leaning
    away. So besides the rotation that fits the mean pose, its mirror image in depth and the body
    leaning forward and back are tried. The best has the least residual together with the least
    error of its bone lengths.
    """
    probe = replace(settings, atoms=settings.start_atoms, anthropometric=True, closed_form=False)
    first = Frames(dictionary, observed, weights, probe, None).first_camera().rotation
    tried = np.concatenate([first[:, None] @ _TURNS, (_DEPTH @ first @ _DEPTH)[:, None]], axis=1)
    count, starts = tried.shape[:2]
    found = Frames(
        dictionary,
        np.repeat(observed, starts, axis=0),
        np.repeat(weights, starts, axis=0),
        probe,
        None,
    ).run(tried.reshape(-1, 3, 3))
    lengths = np.linalg.norm(
        dictionary.bones_of(found.body).reshape(count * starts, dictionary.joints - 1, 3), axis=2
    )
    off = ((lengths - dictionary.bone_lengths) ** 2).mean(axis=1) * found.camera.scale**2
    cost = (found.residual**2 + _LENGTHS_MATTER * off).reshape(count, starts)
    best = np.arange(count) * starts + cost.argmin(axis=1)
    rotation: FloatArray = found.camera.rotation[best]
    return rotation
