"""Weak-perspective cameras (scaled orthography) fitted to poses, batched over frames.

Axes of the image here are x right, y up, in whatever unit the keypoints are in; those of the
camera are x right, y up, z towards the viewer, so that camera and world differ by a rotation. The
caller turns image rows (y down) into this once, at the edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.poses import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class WeakPerspective:
    """N cameras: observed = scale * rotation @ xyz + translation.

    rotation: (N, 3, 3) camera_from_body, proper. scale: (N,) image units per unit of xyz, positive.
    translation: (N, 3) image units; its z is 0 where no depth was observed.
    """

    rotation: FloatArray
    scale: FloatArray
    translation: FloatArray

    def __len__(self) -> int:
        return len(self.scale)

    def project(self, xyz: FloatArray) -> FloatArray:
        """Image points (N, J, 3) of xyz (N, J, 3); the third coordinate is depth, same unit."""
        turned: FloatArray = xyz @ self.rotation.transpose(0, 2, 1)
        return self.scale[:, None, None] * turned + self.translation[:, None]

    def take(self, rows: IntArray | slice) -> WeakPerspective:
        """The cameras of some of the frames."""
        return WeakPerspective(self.rotation[rows], self.scale[rows], self.translation[rows])


def centred(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (N, J, D) less their weighted mean over joints, and that mean (N, D).

    An axis without any weight is left as it is.
    """
    by_axis, joints_last = np.swapaxes(weights, -1, -2), np.swapaxes(values, -1, -2)
    total = by_axis.sum(axis=-1)
    share = by_axis / np.where(total > 0, total, 1)[..., None]
    # As a product of matrices, several times as fast as a sum over joints.
    mean: FloatArray = (share[..., None, :] @ joints_last[..., None])[..., 0, 0]
    return values - mean[..., None, :], mean


def fit_camera(
    xyz: FloatArray,
    observed: FloatArray,
    weights: FloatArray,
    *,
    rotation: FloatArray | None = None,
    steps: int = 4,
) -> WeakPerspective:
    """The cameras that minimise sum w |observed - scale R xyz - translation|^2.

    xyz: (N, J, 3). observed: (N, J, 3) finite. weights: (N, J, 3) not negative, one for each
    coordinate; 0 where a coordinate (the depth, usually) was not observed. rotation: (N, 3, 3) to
    start from; by default that of orthogonal Procrustes between the observed and the 3D points
    (R12), which is exact for full 3D and a start where depth is missing. Then `steps` Gauss-Newton
    steps in rotation and scale, each kept only where it lowers the sum.
    """
    moments = _Moments.of(xyz, observed, weights)
    if rotation is None:
        rotation = _procrustes(moments.cross)
    turned = moments.turned(rotation)
    scale, cost = moments.best_scale(rotation, turned)
    for _ in range(steps):
        trial = moments.gauss_newton(rotation, scale, turned)
        trial_turned = moments.turned(trial)
        trial_scale, trial_cost = moments.best_scale(trial, trial_turned)
        better = trial_cost < cost
        rotation = np.where(better[:, None, None], trial, rotation)
        turned = np.where(better[:, None, None, None], trial_turned, turned)
        scale = np.where(better, trial_scale, scale)
        cost = np.where(better, trial_cost, cost)
    mean = np.einsum("ncd,ncd->nc", rotation, moments.mean)
    translation = moments.observed_mean - scale[:, None] * mean
    return WeakPerspective(rotation, scale, np.where(moments.seen, translation, 0.0))


@dataclass(frozen=True)
class _Moments:
    """What the sum depends on, free of the joints: second moments along each image axis c.

    square: (N, 3, 3, 3) sum w_c x x^T. cross: (N, 3, 3) sum w_c observed_c x. Both centred on the
    weighted means of that axis. mean: (N, 3, 3) mean of x for each axis. observed_mean: (N, 3).
    seen: (N, 3) False for an axis without weight.
    """

    square: FloatArray
    cross: FloatArray
    mean: FloatArray
    observed_mean: FloatArray
    seen: BoolArray

    @staticmethod
    def of(xyz: FloatArray, observed: FloatArray, weights: FloatArray) -> _Moments:
        by_axis = np.ascontiguousarray(weights.transpose(0, 2, 1))
        total = by_axis.sum(axis=-1)
        share = by_axis / np.maximum(total, 1e-300)[..., None]
        mean = share @ xyz
        target = observed.transpose(0, 2, 1)
        observed_mean = (share * target).sum(axis=-1)
        heavy = by_axis[..., None] * xyz[:, None]  # (N, 3, J, 3)
        square = heavy.swapaxes(-1, -2) @ xyz[:, None]
        square -= total[..., None, None] * mean[..., :, None] * mean[..., None, :]
        cross = ((target - observed_mean[..., None])[..., None, :] @ heavy)[..., 0, :]
        return _Moments(square, cross, mean, observed_mean, total > 0)

    def turned(self, rotation: FloatArray) -> FloatArray:
        """The second moments (N, 3, 3, 3) of the points after the rotation."""
        r = rotation[:, None]
        moments: FloatArray = r @ self.square @ r.swapaxes(-1, -2)
        return moments

    def best_scale(self, rotation: FloatArray, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Scale (N,) in closed form, and the sum (N,) less what no camera can change."""
        along = (rotation * self.cross).sum(axis=(1, 2))
        size = np.einsum("nccc->n", turned)
        # A frame of which nothing is seen gets a scale of 1, which the weights make irrelevant.
        seen = size > 0
        scale = np.where(seen, np.maximum(along, 1e-9 * size) / np.where(seen, size, 1.0), 1.0)
        return scale, scale * (scale * size - 2 * along)

    def gauss_newton(
        self, rotation: FloatArray, scale: FloatArray, turned: FloatArray
    ) -> FloatArray:
        """Rotations after one step in rotation vector and relative scale."""
        normal = (_JACOBIAN @ turned @ _JACOBIAN.swapaxes(-1, -2)).sum(axis=1)
        # For axis c the residuals against the turned points: R cross_c / s - turned_c[:, c].
        against = self.cross @ rotation.swapaxes(-1, -2) / scale[:, None, None]
        against -= np.einsum("ncdc->ncd", turned)
        gradient = (_JACOBIAN @ against[..., None]).sum(axis=1)
        damping = 1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-300
        step = np.linalg.solve(normal + damping[:, None, None] * np.eye(4), gradient)
        return rotation_from_vector(step[:, :3, 0]) @ rotation


# Row p of axis c times a turned point is how its coordinate c moves: turning about x, y, z
# ((w x point)_c = w . (point x e_c)), and growing.
_JACOBIAN = np.array(
    [
        [[0, 0, 0], [0, 0, 1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, -1], [0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 0], [0, 0, 1]],
    ],
    dtype=np.float64,
)


def _procrustes(cross: FloatArray) -> FloatArray:
    """Proper rotations (N, 3, 3) of orthogonal Procrustes; depth without weight counts nothing."""
    u, _, vt = np.linalg.svd(cross)
    # The least significant direction (depth, where that is missing) makes the rotation proper.
    u[:, :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
    rotation: FloatArray = u @ vt
    return rotation


def rotation_from_vector(vector: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of rotation vectors (N, 3), radians (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[:, None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle, also at 0
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos(angle)) / angle^2
    rotation: FloatArray = np.eye(3) + sine * cross + versine * (cross @ cross)
    return rotation
