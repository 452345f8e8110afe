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

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dance2pose.lifting.anthropometric import constrained_least_squares
from dance2pose.lifting.camera import WeakPerspective, centred, fit_camera
from dance2pose.lifting.dictionary import Dictionary
from dance2pose.poses import BoolArray, FloatArray, IntArray

_CHUNK = 512  # frames worked on together: their atoms stay in the processor's cache


class PoseLimits(Protocol):
    """What tells possible poses from impossible ones (`lifting.limits.Limits`)."""

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        """Flags (..., J - 1) of poses (..., J, 3)."""
        ...


@dataclass(frozen=True)
class PursuitSettings:
    """atoms: the most a pose is made of. tolerance: stop where the residual falls below this part
    of the size of the figure in the image. anthropometric: hold the sum of squared bone lengths.
    ridge: penalty on coefficients relative to their own normal matrix. tries: next-best atoms
    tried where an atom breaks a limit."""

    atoms: int = 10
    tolerance: float = 0.005
    anthropometric: bool = True
    ridge: float = 1e-3
    tries: int = 8
    normalised: bool = True


@dataclass(frozen=True)
class Pursuit:
    """N poses found.

    body: (N, J, 3) mm in body axes. camera: what turns them into the image. active: (N, k) atoms
    in the order chosen, -1 where a frame stopped earlier. coefficients: (N, k) mm, 0 there.
    residual: (N,) weighted root mean square of what is left, image units.
    """

    body: FloatArray
    camera: WeakPerspective
    active: IntArray
    coefficients: FloatArray
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
    for start in range(0, max(len(observed), 1), _CHUNK):
        rows = slice(start, start + _CHUNK)
        chunk = _Frames(dictionary, observed[rows], weights[rows], settings, limits)
        parts.append(chunk.run(None if rotation is None else rotation[rows]))
    return _joined(parts)


def _joined(parts: list[Pursuit]) -> Pursuit:
    return Pursuit(
        np.concatenate([p.body for p in parts]),
        WeakPerspective(
            np.concatenate([p.camera.rotation for p in parts]),
            np.concatenate([p.camera.scale for p in parts]),
            np.concatenate([p.camera.translation for p in parts]),
        ),
        np.concatenate([p.active for p in parts]),
        np.concatenate([p.coefficients for p in parts]),
        np.concatenate([p.residual for p in parts]),
    )


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

    def run(self, rotation: FloatArray | None) -> Pursuit:
        count, most = len(self.observed), self.settings.atoms
        self.body = np.repeat(self.dictionary.mean[None], count, axis=0)
        self.active = np.full((count, most), -1, dtype=np.int64)
        self.coefficients = np.zeros((count, most))
        self.camera = fit_camera(self.body, self.observed, self.weights, rotation=rotation, steps=6)
        going = self.weights[..., :2].any(axis=(1, 2))
        for step in range(most):
            going &= self._cost() > self.enough
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            going[rows] = self._take_atom(rows, step)
            self._refit_camera(np.flatnonzero(going))
        total = np.maximum(self.weights.sum(axis=(1, 2)), 1e-300)
        return Pursuit(
            self.body, self.camera, self.active, self.coefficients, np.sqrt(self._cost() / total)
        )

    def _left(self, rows: IntArray | slice) -> FloatArray:
        """Weighted residuals (n, J, 3)."""
        camera = self.camera.take(rows)
        drawn = centred(camera.project(self.body[rows]), self.weights[rows])[0]
        left: FloatArray = self.weights[rows] * (self.target[rows] - drawn)
        return left

    def _cost(self) -> FloatArray:
        camera = self.camera
        drawn = centred(camera.project(self.body), self.weights)[0]
        left = self.target - drawn
        cost: FloatArray = np.einsum("njd,njd->n", self.weights * left, left)
        return cost

    def _take_atom(self, rows: IntArray, step: int) -> BoolArray:
        """Give each of the frames its next atom; False where none is allowed."""
        match = self._match(rows)
        np.put_along_axis(match, np.maximum(self.active[rows, :step], 0), 0.0, axis=1)
        found = np.zeros(len(rows), dtype=bool)
        searching = np.arange(len(rows))
        before = self._flags(self.body[rows])
        for _ in range(self.settings.tries if self.limits is not None else 1):
            atom = match[searching].argmax(axis=1)
            match[searching, atom] = 0.0
            frames = rows[searching]
            active = np.concatenate([self.active[frames, :step], atom[:, None]], axis=1)
            coefficients = self._coefficients(frames, active)
            body = self.dictionary.pose(active, coefficients)
            ok = np.isfinite(coefficients).all(axis=1)
            if before is not None:
                after = self._flags(body)
                assert after is not None
                ok &= (after | ~before[searching]).all(axis=1)
            taken = frames[ok]
            self.active[taken, : step + 1] = active[ok]
            self.coefficients[taken, : step + 1] = coefficients[ok]
            self.body[taken] = body[ok]
            found[searching[ok]] = True
            searching = searching[~ok]
            if not len(searching):
                break
        return found

    def _flags(self, body: FloatArray) -> BoolArray | None:
        return None if self.limits is None else self.limits.is_valid(body)

    def _match(self, rows: IntArray) -> FloatArray:
        """How well each atom explains what is left: |correlation| (n, K) in the image."""
        rotation = self.camera.rotation[rows]
        back = (self._left(rows) @ rotation).reshape(len(rows), -1)
        match: FloatArray = np.abs(back @ self.dictionary.flat_atoms.T)
        if self.settings.normalised:
            match /= self._projected_norms(rows, rotation)
        return match

    def _projected_norms(self, rows: IntArray, rotation: FloatArray) -> FloatArray:
        """Norms (n, K) of the atoms as the cameras see them, weighted and centred."""
        count, joints = len(rows), self.dictionary.joints
        stacked = self.dictionary.atoms.transpose(2, 1, 0).reshape(3, -1)  # (3, J K)
        square = np.zeros((count, len(self.dictionary)))
        for axis in range(self.axes):
            seen = (rotation[:, axis] @ stacked).reshape(count, joints, -1)
            w = self.weights[rows, :, axis]
            total = np.maximum(w.sum(axis=1), 1e-300)[:, None]
            square += np.einsum("nj,njk,njk->nk", w, seen, seen, optimize=False)
            square -= (w[:, None] @ seen)[:, 0] ** 2 / total
        norms: FloatArray = np.sqrt(np.maximum(square, 1e-12))
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
        if not self.settings.anthropometric:
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
            steps=2,
        )
        self.camera.rotation[rows] = camera.rotation
        self.camera.scale[rows] = camera.scale
        self.camera.translation[rows] = camera.translation
