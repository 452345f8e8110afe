"""Least squares under R12's anthropometric constraint, in closed form, batched over frames.

The sum of squared bone lengths of a pose mean + sum w_i atom_i is held at a known constant:
minimise |A w - r|^2 subject to |D w + d|^2 = C, D being the bone vectors of the atoms and d those
of the mean pose. This is least squares with one quadratic equality constraint; its multiplier is
the one root of a secular equation (R12, section 3.3; Gander, Golub, von Matt 1989).
"""

from __future__ import annotations

import numpy as np

from dance2pose.poses import FloatArray

_NEWTON_STEPS = 12


def constrained_least_squares(
    normal: FloatArray,
    right: FloatArray,
    bone_gram: FloatArray,
    bone_mean: FloatArray,
    mean_square: float,
    total: float,
) -> FloatArray:
    """The coefficients w (N, k).

    normal: A^T A (N, k, k). right: A^T r (N, k). bone_gram: D^T D (N, k, k), positive definite.
    bone_mean: D^T d (N, k). mean_square: |d|^2. total: C. Where no w can reach C (the mean pose
    cannot be made that small) the smallest pose is returned.
    """
    lower = np.linalg.cholesky(bone_gram)
    # With w = L^-T (y - shift) the constraint is |y|^2 = radius^2.
    shift = _solve_lower(lower, bone_mean)
    radius2 = np.maximum(total - mean_square + (shift**2).sum(axis=-1), 1e-12 * total)
    half = np.linalg.solve(lower, normal)
    reduced = np.linalg.solve(lower, half.transpose(0, 2, 1))
    reduced = (reduced + reduced.transpose(0, 2, 1)) / 2
    values, vectors = np.linalg.eigh(reduced)
    target = _solve_lower(lower, right) + (reduced @ shift[..., None])[..., 0]
    g = (vectors.transpose(0, 2, 1) @ target[..., None])[..., 0]
    y = (vectors @ _on_sphere(values, g, radius2)[..., None])[..., 0]
    w: FloatArray = np.linalg.solve(lower.transpose(0, 2, 1), (y - shift)[..., None])[..., 0]
    return w


def _solve_lower(lower: FloatArray, right: FloatArray) -> FloatArray:
    solved: FloatArray = np.linalg.solve(lower, right[..., None])[..., 0]
    return solved


def _on_sphere(values: FloatArray, g: FloatArray, radius2: FloatArray) -> FloatArray:
    """Minimise y^T V y - 2 g^T y over |y|^2 = radius2, V diagonal (N, k), ascending.

    y = g / (values + m) with the one multiplier m > -values[0] for which |y| is right. Newton's
    method on 1/|y| - 1/radius, which is nearly linear in m, starts at the left of the root and
    never passes it.
    """
    radius = np.sqrt(radius2)
    smallest = 1e-10 * np.linalg.norm(g, axis=-1) + 1e-300
    # Where g has no part along the softest direction (the hard case) it is given a tiny one: the
    # limit of the solution is then reached along that direction.
    g = g.copy()
    tiny = np.abs(g[:, 0]) < smallest
    g[tiny, 0] = smallest[tiny]
    gap = values - values[:, :1]
    m = np.abs(g[:, 0]) / radius  # measured from -values[0]
    for _ in range(_NEWTON_STEPS):
        y = g / (gap + m[:, None])
        square = (y**2).sum(axis=-1)
        slope = (y**2 / (gap + m[:, None])).sum(axis=-1)
        norm = np.sqrt(square)
        m = np.maximum(m + (norm - radius) / radius * square / slope, 1e-300)
    y = g / (gap + m[:, None])
    on: FloatArray = y * (radius / np.linalg.norm(y, axis=-1))[:, None]
    return on
