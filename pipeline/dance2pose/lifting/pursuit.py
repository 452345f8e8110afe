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

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.lifting.anthropometric import constrained_least_squares
from dance2pose.lifting.camera import WeakPerspective, centred, fit_camera, rotation_from_vector
from dance2pose.lifting.dictionary import Dictionary
from dance2pose.poses import BoolArray, FloatArray, IntArray

_CHUNK = 512  # frames worked on together: their atoms stay in the processor's cache


# Mirrors depth on either side of a rotation, which so stays one.
_DEPTH = np.diag([1.0, 1.0, -1.0])
# Turns of the body that are tried first: none, leaning forward, leaning back (degrees).
_TURNS = rotation_from_vector(np.radians(np.array([[0, 0, 0], [30, 0, 0], [-30, 0, 0]])))
_LENGTHS_MATTER = 0.1
# Gauss-Newton steps of the camera: at the start, and after each atom, where little changes.
_FIRST_CAMERA_STEPS, _CAMERA_STEPS = 6, 1


class PoseLimits(Protocol):
    """What tells possible poses from impossible ones (`lifting.limits.Limits`)."""

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., J - 1) of poses (..., J, 3)."""
        ...


@dataclass(frozen=True)
class PursuitSettings:
    """atoms: the most that a pose is made of (K). tolerance: a frame is done when its residual is
    below this part of the figure's size in the image. ridge: penalty on the squared coefficients,
    relative to their normal matrix. normalised: match atoms by cosine in the image rather than by
    plain correlation. tries: next-best atoms tried where one breaks a limit.

    anthropometric: hold the sum of squared bone lengths at the body's. With closed_form that is
    R12's constraint on the coefficients, through its secular equation; without, pose and camera
    are scaled against each other at the end, which leaves the image as it is.

    start_atoms: atoms given to each of several first rotations before the best is chosen; 0 starts
    from the mean pose's alone, as R12 do.
    """

    atoms: int = 16
    tolerance: float = 0.005
    ridge: float = 0.15
    normalised: bool = True
    tries: int = 4
    anthropometric: bool = True
    closed_form: bool = False
    start_atoms: int = 4

    def __post_init__(self) -> None:
        if self.atoms < 0 or self.start_atoms < 0 or self.tries < 1:
            raise UsageError(
                f"pursuit of {self.atoms} atoms, {self.start_atoms} to start with, {self.tries} "
                "tries; expected 0 or more, 0 or more, 1 or more"
            )
        if not (self.tolerance >= 0 and self.ridge >= 0):
            raise UsageError(
                f"tolerance {self.tolerance} and ridge {self.ridge}; expected 0 or more"
            )


@dataclass(frozen=True)
class Pursuit:
    """N poses found.

    body: (N, J, 3) mm in body axes, growth times mean + sum of coefficients times atoms. camera:
    what turns them into the image. active: (N, k) atoms in the order chosen, -1 where a frame
    stopped earlier. coefficients: (N, k) mm, 0 there. growth: (N,) what the anthropometric
    constraint made of the pose's size. residual: (N,) weighted root mean square of what is left,
    image units.
    """

    body: FloatArray
    camera: WeakPerspective
    active: IntArray
    coefficients: FloatArray
    growth: FloatArray
    residual: FloatArray

    @property
    def xyz(self) -> FloatArray:
        """Poses (N, J, 3) mm as the camera sees them: x right, y up, z towards the viewer."""
        turned: FloatArray = self.body @ self.camera.rotation.transpose(0, 2, 1)
        return turned


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
    rotation: (N, 3, 3) camera_from_body to start from; by default that of the mean pose.
    """
    settings = settings or PursuitSettings()
    parts = []
    for first in range(0, max(len(observed), 1), _CHUNK):
        rows = slice(first, first + _CHUNK)
        frames = _Frames(dictionary, observed[rows], weights[rows], settings, limits)
        if rotation is not None:
            start = rotation[rows]
        elif settings.start_atoms:
            start = _best_start(dictionary, observed[rows], weights[rows], settings)
        else:
            start = frames.first_camera().rotation
        parts.append(frames.run(start))
    return _joined(parts)


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
    first = _Frames(dictionary, observed, weights, probe, None).first_camera().rotation
    tried = np.concatenate([first[:, None] @ _TURNS, (_DEPTH @ first @ _DEPTH)[:, None]], axis=1)
    count, starts = tried.shape[:2]
    found = _Frames(
        dictionary,
        np.repeat(observed, starts, axis=0),
        np.repeat(weights, starts, axis=0),
        probe,
        None,
    ).run(tried.reshape(-1, 3, 3))
    lengths = np.linalg.norm(
        dictionary.bones_of(found.body).reshape(len(found.body), -1, 3), axis=2
    )
    off = ((lengths - dictionary.bone_lengths) ** 2).mean(axis=1) * found.camera.scale**2
    cost = (found.residual**2 + _LENGTHS_MATTER * off).reshape(count, starts)
    best = np.arange(count) * starts + cost.argmin(axis=1)
    rotation: FloatArray = found.camera.rotation[best]
    return rotation


class _Frames:
    """The state of a batch of frames during the pursuit."""

    def __init__(
        self,
        dictionary: Dictionary,
        observed: FloatArray,
        weights: FloatArray,
        settings: PursuitSettings,
        limits: PoseLimits | None,
    ) -> None:
        self.dictionary, self.settings, self.limits = dictionary, settings, limits
        self.weights = weights.astype(np.float64)
        seen = self.weights > 0
        self.observed = np.where(seen, observed, 0.0).astype(np.float64)
        # Depth, where nobody tells it, costs nothing if its axis is left out.
        self.axes = 3 if seen[..., 2].any() else 2
        self.target, _ = centred(self.observed, self.weights)
        size2 = np.einsum("njd,njd->n", self.weights * self.target, self.target)
        self.enough = settings.tolerance**2 * size2
        self.gram = dictionary.atom_bones @ dictionary.atom_bones.T
        self.bone_mean = dictionary.atom_bones @ dictionary.mean_bones
        self.mean_square = float(dictionary.mean_bones @ dictionary.mean_bones)

    def first_camera(self, rotation: FloatArray | None = None) -> WeakPerspective:
        """The cameras that see the mean pose as the observed figure."""
        mean = np.repeat(self.dictionary.mean[None], len(self.observed), axis=0)
        steps = _CAMERA_STEPS if rotation is not None else _FIRST_CAMERA_STEPS
        return fit_camera(mean, self.observed, self.weights, rotation=rotation, steps=steps)

    def run(self, rotation: FloatArray) -> Pursuit:
        """The pursuit from these first rotations (N, 3, 3)."""
        count, most = len(self.observed), self.settings.atoms
        self.body = np.repeat(self.dictionary.mean[None], count, axis=0)
        self.active = np.full((count, most), -1, dtype=np.int64)
        self.coefficients = np.zeros((count, most))
        self.camera = self.first_camera(rotation)
        self.left = np.empty_like(self.target)
        self.cost = np.empty(count)
        self._look(slice(None))
        self.flags = None if self.limits is None else self.limits.is_valid(self.body)
        going = self.weights[..., :2].any(axis=(1, 2))
        for step in range(most):
            going &= self.cost > self.enough
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            going[rows] = self._take_atom(rows, step)
            self._refit_camera(np.flatnonzero(going))
        growth = np.ones(count)
        if self.settings.anthropometric and not self.settings.closed_form:
            square = (self.dictionary.bones_of(self.body) ** 2).sum(axis=1)
            growth = np.sqrt(self.dictionary.sum_of_squared_lengths / square)
        total = np.maximum(self.weights.sum(axis=(1, 2)), 1e-300)
        camera = self.camera
        return Pursuit(
            self.body * growth[:, None, None],
            WeakPerspective(camera.rotation, camera.scale / growth, camera.translation),
            self.active,
            self.coefficients,
            growth,
            np.sqrt(self.cost / total),
        )

    def _look(self, rows: IntArray | slice) -> None:
        """Bring the weighted residuals `left` (n, J, 3) and their sum of squares up to date."""
        drawn = centred(self.camera.take(rows).project(self.body[rows]), self.weights[rows])[0]
        left = self.target[rows] - drawn
        self.left[rows] = self.weights[rows] * left
        self.cost[rows] = (self.left[rows] * left).sum(axis=(1, 2))

    def _take_atom(self, rows: IntArray, step: int) -> BoolArray:
        """Give each of the frames its next atom; False where none is allowed."""
        match = self._match(rows)
        np.put_along_axis(match, np.maximum(self.active[rows, :step], 0), 0.0, axis=1)
        found = np.zeros(len(rows), dtype=bool)
        searching = np.arange(len(rows))
        before = None if self.flags is None else self.flags[rows]
        for _ in range(self.settings.tries if self.limits is not None else 1):
            atom = match[searching].argmax(axis=1)
            match[searching, atom] = 0.0
            frames = rows[searching]
            active = np.concatenate([self.active[frames, :step], atom[:, None]], axis=1)
            coefficients = self._coefficients(frames, active)
            body = self.dictionary.pose(active, coefficients)
            ok = np.isfinite(coefficients).all(axis=1)
            if self.limits is not None and self.flags is not None and before is not None:
                after = self.limits.is_valid(body)
                ok &= (after | ~before[searching]).all(axis=1)
                self.flags[frames[ok]] = after[ok]
            taken = frames[ok]
            self.active[taken, : step + 1] = active[ok]
            self.coefficients[taken, : step + 1] = coefficients[ok]
            self.body[taken] = body[ok]
            found[searching[ok]] = True
            searching = searching[~ok]
            if not len(searching):
                break
        return found

    def _match(self, rows: IntArray) -> FloatArray:
        """How well each atom explains what is left: |correlation| (n, K) in the image."""
        rotation = self.camera.rotation[rows]
        back = (self.left[rows] @ rotation).reshape(len(rows), -1)
        # Single precision: this only ranks the atoms.
        match: FloatArray = np.abs(back.astype(np.float32) @ self.dictionary.flat_atoms32.T)
        if self.settings.normalised:
            match /= self._projected_norms(rotation)
        return match

    def _projected_norms(self, rotation: FloatArray) -> FloatArray:
        """Norms (n, K) of the atoms as cameras (n, 3, 3) see them, every joint counting alike."""
        seen = rotation[:, : self.axes]
        both = (seen.transpose(0, 2, 1) @ seen).reshape(-1, 9).astype(np.float32)
        norms: FloatArray = np.sqrt(np.maximum(both @ self.dictionary.spread, 1e-6))
        return norms

    def _coefficients(self, rows: IntArray, active: IntArray) -> FloatArray:
        """Coefficients (n, k) of the active atoms (n, k) with the cameras as they are."""
        n, k = active.shape
        rotation: FloatArray = self.camera.rotation[rows, : self.axes].transpose(0, 2, 1)
        scale = self.camera.scale[rows]
        weights = self.weights[rows, :, : self.axes]
        atoms = self.dictionary.flat_atoms[active].reshape(n, k * self.dictionary.joints, 3)
        turned = (atoms @ rotation).reshape(n, k, -1, self.axes) * scale[:, None, None, None]
        drawn = centred(turned, weights[:, None])[0].reshape(n, k, -1)
        mean = scale[:, None, None] * (self.dictionary.mean @ rotation)
        left = (self.target[rows, :, : self.axes] - centred(mean, weights)[0]).reshape(n, -1)
        flat = weights.reshape(n, 1, -1)
        weighted = drawn * flat
        normal = weighted @ drawn.transpose(0, 2, 1)
        right = (weighted @ left[..., None])[..., 0]
        trace = np.trace(normal, axis1=1, axis2=2) / k
        normal += (self.settings.ridge * trace + 1e-12)[:, None, None] * np.eye(k)
        if not (self.settings.anthropometric and self.settings.closed_form):
            solved: FloatArray = np.linalg.solve(normal, right[..., None])[..., 0]
            return solved
        gram = self.gram[active[:, :, None], active[:, None, :]] + 1e-6 * np.eye(k)
        return constrained_least_squares(
            normal,
            right,
            gram,
            self.bone_mean[active],
            self.mean_square,
            self.dictionary.sum_of_squared_lengths,
        )

    def _refit_camera(self, rows: IntArray) -> None:
        if not len(rows):
            return
        camera = fit_camera(
            self.body[rows],
            self.observed[rows],
            self.weights[rows],
            rotation=self.camera.rotation[rows],
            steps=_CAMERA_STEPS,
        )
        self.camera.rotation[rows] = camera.rotation
        self.camera.scale[rows] = camera.scale
        self.camera.translation[rows] = camera.translation
        self._look(rows)
