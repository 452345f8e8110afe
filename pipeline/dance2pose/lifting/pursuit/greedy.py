"""One batch of frames on its way through the pursuit; `pursuit` is the door to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.lifting.pursuit.anthropometric import constrained_least_squares
from dance2pose.lifting.pursuit.camera import WeakPerspective, centred, fit_camera
from dance2pose.lifting.pursuit.dictionary import Dictionary
from dance2pose.poses import BoolArray, FloatArray, IntArray

# Gauss-Newton steps of the camera: at the start, and after each atom, where little changes.
FIRST_CAMERA_STEPS, CAMERA_STEPS = 6, 1


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

    polish: rounds of coefficients and cameras after the last atom.

    start_atoms: atoms given to each of several first rotations before the best is chosen; 0 starts
    from the mean pose's alone, as R12 do.
    """

    atoms: int = 16
    tolerance: float = 0.005
    ridge: float = 0.15
    normalised: bool = True
    tries: int = 8
    anthropometric: bool = True
    closed_form: bool = False
    polish: int = 0
    start_atoms: int = 4

    def __post_init__(self) -> None:
        if self.atoms < 0 or self.start_atoms < 0 or self.tries < 1:
            raise UsageError(
                f"pursuit of {self.atoms} atoms, {self.start_atoms} to start with, {self.tries} "
                "tries; expected 0 or more, 0 or more, 1 or more"
            )
        if self.polish < 0:
            raise UsageError(f"{self.polish} rounds of polish; expected 0 or more")
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


class Frames:
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
        by_axis = self.weights.sum(axis=1)
        heaviest = np.maximum(by_axis.max(axis=1, keepdims=True), 1e-300)
        self.axis_weight = np.sqrt(by_axis / heaviest)
        self.target, _ = centred(self.observed, self.weights)
        size2 = np.einsum("njd,njd->n", self.weights * self.target, self.target)
        self.enough = settings.tolerance**2 * size2
        self.gram = dictionary.atom_bones @ dictionary.atom_bones.T
        self.bone_mean = dictionary.atom_bones @ dictionary.mean_bones
        self.mean_square = float(dictionary.mean_bones @ dictionary.mean_bones)

    def first_camera(self, rotation: FloatArray | None = None) -> WeakPerspective:
        """The cameras that see the mean pose as the observed figure."""
        mean = np.repeat(self.dictionary.mean[None], len(self.observed), axis=0)
        steps = CAMERA_STEPS if rotation is not None else FIRST_CAMERA_STEPS
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
        for _ in range(self.settings.polish):
            self._polish()
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
        for _ in range(self.settings.tries if self.limits is not None else 1):
            atom = match[searching].argmax(axis=1)
            there = match[searching, atom] > 0
            searching, atom = searching[there], atom[there]
            if not len(searching):
                break
            match[searching, atom] = 0.0
            frames = rows[searching]
            ok = self._fit(frames, np.column_stack([self.active[frames, :step], atom]))
            found[searching[ok]] = True
            searching = searching[~ok]
            if not len(searching):
                break
        return found

    def _fit(self, rows: IntArray, active: IntArray) -> BoolArray:
        """Give frames the poses of these active atoms (n, k); False where that breaks a limit.

        A bone that was broken before, as those of the mean pose may be, is no reason to refuse.
        """
        coefficients = self._coefficients(rows, active)
        body = self.dictionary.pose(active, coefficients)
        ok: BoolArray = np.array(np.isfinite(coefficients).all(axis=1))
        if self.limits is not None and self.flags is not None:
            flags = self.limits.is_valid(body)
            ok &= (flags | ~self.flags[rows]).all(axis=1)
            self.flags[rows[ok]] = flags[ok]
        taken = rows[ok]
        self.active[taken, : active.shape[1]] = active[ok]
        self.coefficients[taken, : active.shape[1]] = coefficients[ok]
        self.body[taken] = body[ok]
        return ok

    def _polish(self) -> None:
        """Coefficients and cameras once more, the active sets staying as they are."""
        sizes = (self.active >= 0).sum(axis=1)
        for size in np.unique(sizes[sizes > 0]):
            rows = np.flatnonzero(sizes == size)
            self._refit_camera(rows[self._fit(rows, self.active[rows, :size])])

    def _match(self, rows: IntArray) -> FloatArray:
        """How well each atom explains what is left: |correlation| (n, K) in the image."""
        rotation = self.camera.rotation[rows]
        back = (self.left[rows] @ rotation).reshape(len(rows), -1)
        # Single precision: this only ranks the atoms.
        match: FloatArray = np.abs(back.astype(np.float32) @ self.dictionary.flat_atoms32.T)
        if self.settings.normalised:
            match /= self._projected_norms(rows, rotation)
        return match

    def _projected_norms(self, rows: IntArray, rotation: FloatArray) -> FloatArray:
        """Norms (n, K) of the atoms as the cameras see them: every joint counts alike, every axis
        by what it weighs beside the heaviest."""
        seen = rotation[:, : self.axes] * self.axis_weight[rows, : self.axes, None]
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
            steps=CAMERA_STEPS,
        )
        self.camera.rotation[rows] = camera.rotation
        self.camera.scale[rows] = camera.scale
        self.camera.translation[rows] = camera.translation
        self._look(rows)
