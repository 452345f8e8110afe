"""Weak-perspective cameras (scaled orthography) fitted to poses, batched over frames.

Axes of the image here are x right, y up, in whatever unit the keypoints are in; those of the
camera are x right, y up, z towards the viewer, so that camera and world differ by a rotation. The
caller turns image rows (y down) into this once, at the edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.poses import FloatArray, IntArray


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
    total = weights.sum(axis=-2)
    mean = (weights * values).sum(axis=-2) / np.where(total > 0, total, 1)
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
    target, target_mean = centred(observed, weights)
    if rotation is None:
        rotation = _procrustes(centred(xyz, weights)[0], target, weights)
    scale, cost, turned = _best_scale(xyz, target, weights, rotation)
    for _ in range(steps):
        trial = _gauss_newton(turned, scale, target, weights, rotation)
        trial_scale, trial_cost, trial_turned = _best_scale(xyz, target, weights, trial)
        better = trial_cost < cost
        rotation = np.where(better[:, None, None], trial, rotation)
        scale = np.where(better, trial_scale, scale)
        cost = np.where(better, trial_cost, cost)
        turned = np.where(better[:, None, None], trial_turned, turned)
    mean = centred(xyz @ rotation.transpose(0, 2, 1), weights)[1]
    translation = target_mean - scale[:, None] * mean
    return WeakPerspective(rotation, scale, np.where(weights.any(axis=1), translation, 0.0))


def _procrustes(xyz: FloatArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    """Proper rotations (N, 3, 3) of orthogonal Procrustes; depth without weight counts nothing."""
    covariance = (weights * target).transpose(0, 2, 1) @ xyz
    u, _, vt = np.linalg.svd(covariance)
    # The least significant direction (depth, where that is missing) makes the rotation proper.
    u[:, :, 2] *= np.sign(np.linalg.det(u) * np.linalg.det(vt))[:, None]
    rotation: FloatArray = u @ vt
    return rotation


def _best_scale(
    xyz: FloatArray, target: FloatArray, weights: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Scale (N,) in closed form, what remains of the sum (N,), and the turned, centred points."""
    turned = centred(xyz @ rotation.transpose(0, 2, 1), weights)[0]
    along = np.einsum("njd,njd->n", weights * turned, target)
    size = np.einsum("njd,njd->n", weights * turned, turned)
    scale = np.maximum(along, 1e-9 * size) / np.maximum(size, 1e-300)
    left = target - scale[:, None, None] * turned
    return scale, np.einsum("njd,njd->n", weights * left, left), turned


def _gauss_newton(
    turned: FloatArray,
    scale: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
) -> FloatArray:
    """Rotations after one damped step in (rotation vector, relative scale)."""
    x, y, z = np.moveaxis(scale[:, None, None] * turned, -1, 0)
    nought = np.zeros_like(x)
    # Columns of the Jacobian (N, J, 3, 4): turning about x, y, z, and growing.
    jacobian = np.stack(
        [
            np.stack([nought, -z, y], axis=-1),
            np.stack([z, nought, -x], axis=-1),
            np.stack([-y, x, nought], axis=-1),
            np.stack([x, y, z], axis=-1),
        ],
        axis=-1,
    )
    # Turned points are centred axis by axis; their cross products have to be centred again.
    total = np.maximum(weights.sum(axis=1), 1e-300)
    jacobian -= (np.einsum("njd,njdp->ndp", weights, jacobian) / total[..., None])[:, None]
    count = len(x)
    rows = jacobian.reshape(count, -1, 4)
    left = (target - np.stack([x, y, z], axis=-1)) * weights
    weighted = weights.reshape(count, -1, 1) * rows
    normal = rows.transpose(0, 2, 1) @ weighted
    gradient = rows.transpose(0, 2, 1) @ left.reshape(count, -1, 1)
    trace = np.trace(normal, axis1=1, axis2=2)
    damping = np.maximum(1e-9 * trace, 1e-300)
    step = np.linalg.solve(normal + damping[:, None, None] * np.eye(4), gradient)[:, :3, 0]
    return rotation_from_vector(step) @ rotation


def rotation_from_vector(vector: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of rotation vectors (N, 3), radians (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[:, None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    nought = np.zeros_like(x)
    cross = np.stack([nought, -z, y, z, nought, -x, -y, x, nought], axis=-1).reshape(-1, 3, 3)
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle, also at 0
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos(angle)) / angle^2
    rotation: FloatArray = np.eye(3) + sine * cross + versine * (cross @ cross)
    return rotation
