"""Weak-perspective cameras: planted ones recovered, and an independent optimiser as reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dance2pose.lifting.pursuit.alignment import (
    body_axes,
    mirrored,
    similarity,
    to_body_axes,
)
from dance2pose.lifting.pursuit.camera import centred, fit_camera, rotation_from_vector
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

N, J = 5, 17


def scene(seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Poses, rotations, scales, translations and exact observations (all three coordinates)."""
    rng = np.random.default_rng(seed)
    xyz = 300 * rng.normal(size=(N, J, 3))
    rotation = Rotation.random(N, random_state=seed).as_matrix()
    scale = rng.uniform(0.1, 3, N)
    translation = rng.uniform(-500, 500, (N, 3))
    observed = scale[:, None, None] * xyz @ rotation.transpose(0, 2, 1) + translation[:, None]
    return xyz, rotation, scale, translation, observed


def planar(weights: FloatArray) -> FloatArray:
    """Weights (N, J) for x and y, none for depth."""
    return np.stack([weights, weights, np.zeros_like(weights)], axis=-1)


def test_full_3d_is_solved_exactly() -> None:
    xyz, rotation, scale, translation, observed = scene()
    camera = fit_camera(xyz, observed, np.ones((N, J, 3)), steps=1)
    np.testing.assert_allclose(camera.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(camera.scale, scale)
    np.testing.assert_allclose(camera.translation, translation, atol=1e-6)
    np.testing.assert_allclose(camera.project(xyz), observed, atol=1e-6)


def test_planted_cameras_are_recovered_from_x_and_y() -> None:
    xyz, rotation, scale, translation, observed = scene()
    weights = planar(np.random.default_rng(1).uniform(0.2, 1, (N, J)))
    weights[:, 3] = 0
    observed[..., 2] = 7e6  # depth that was not observed must not matter
    observed[:, 3] = -7e6
    near = rotation_from_vector(np.full((N, 3), 0.3)) @ rotation
    camera = fit_camera(xyz, observed, weights, rotation=near, steps=12)
    np.testing.assert_allclose(camera.rotation, rotation, atol=1e-8)
    np.testing.assert_allclose(camera.scale, scale, rtol=1e-8)
    np.testing.assert_allclose(camera.translation[:, :2], translation[:, :2], atol=1e-5)
    assert not camera.translation[:, 2].any()


def test_the_fit_is_where_an_independent_optimiser_ends() -> None:
    """Noise, and a weight of its own for every coordinate, depth included."""
    xyz, rotation, _, _, observed = scene(2)
    rng = np.random.default_rng(3)
    observed = observed + 20 * rng.normal(size=observed.shape)
    weights = rng.uniform(0, 1, (N, J, 3))
    camera = fit_camera(xyz, observed, weights, rotation=rotation, steps=20)
    for n in range(N):

        def residuals(p: FloatArray, n: int = n) -> FloatArray:
            turned = xyz[n] @ Rotation.from_rotvec(p[:3]).as_matrix().T
            left: FloatArray = np.sqrt(weights[n]) * (observed[n] - p[3] * turned - p[4:])
            return left.ravel()

        start = np.r_[Rotation.from_matrix(rotation[n]).as_rotvec(), 1, 0, 0, 0]
        best = least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        mine = np.r_[
            Rotation.from_matrix(camera.rotation[n]).as_rotvec(),
            camera.scale[n],
            camera.translation[n],
        ]
        cost = (residuals(mine) ** 2).sum()
        np.testing.assert_allclose(cost, 2 * best.cost, rtol=1e-7)


def test_steps_never_make_the_fit_worse() -> None:
    xyz, _, _, _, observed = scene(4)
    weights = planar(np.ones((N, J)))
    costs = []
    for steps in range(8):
        camera = fit_camera(xyz, observed, weights, steps=steps)
        left = centred(observed - camera.project(xyz), weights)[0]
        costs.append((weights * left**2).sum(axis=(1, 2)))
    assert (np.diff(costs, axis=0) <= 1e-6 * costs[0]).all()
    assert np.isfinite(costs).all()


def test_rotations_are_proper_and_scales_positive_even_for_mirrored_observations() -> None:
    xyz, _, _, _, observed = scene(5)
    for weights in (np.ones((N, J, 3)), planar(np.ones((N, J)))):
        camera = fit_camera(xyz, -observed, weights)
        np.testing.assert_allclose(np.linalg.det(camera.rotation), 1)
        assert (camera.scale > 0).all()


def test_frames_without_any_weight_give_finite_cameras() -> None:
    xyz, _, _, _, observed = scene(6)
    camera = fit_camera(xyz, observed, np.zeros((N, J, 3)))
    assert np.isfinite(camera.rotation).all() and np.isfinite(camera.scale).all()


@given(
    st.floats(0.01, 100),
    st.floats(-1000, 1000),
    st.floats(-np.pi, np.pi),
)
def test_image_scale_place_and_turn_go_into_the_camera(
    scale: float, shift: float, turn: float
) -> None:
    xyz, _, _, _, observed = scene(7)
    weights = planar(np.ones((N, J)))
    noisy = observed + 10 * np.random.default_rng(8).normal(size=observed.shape)
    roll = Rotation.from_euler("z", turn).as_matrix()
    moved = scale * noisy @ roll.T + np.array([shift, -shift, 0])
    before = fit_camera(xyz, noisy, weights)
    after = fit_camera(xyz, moved, weights)
    np.testing.assert_allclose(after.rotation, roll @ before.rotation, atol=1e-6)
    np.testing.assert_allclose(after.scale, scale * before.scale, rtol=1e-6)


@given(st.lists(st.floats(-4, 4), min_size=3, max_size=3))
def test_rotation_vectors_as_in_scipy(vector: list[float]) -> None:
    for v in (np.array([vector]), np.array([vector]) * 1e-9):
        np.testing.assert_allclose(
            rotation_from_vector(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-12
        )


def test_half_turns_and_no_turn() -> None:
    vectors = np.array([[0, 0, 0], [np.pi, 0, 0], [0, -np.pi, 0]])
    expected = [np.eye(3), np.diag([1, -1, -1]), np.diag([-1, 1, -1])]
    np.testing.assert_allclose(rotation_from_vector(vectors), expected, atol=1e-12)


@pytest.mark.parametrize("name", ["cmu17", "paper15", "body17"])
def test_body_axes_remove_any_rotation_and_keep_shape(name: str) -> None:
    known = get(name)
    rng = np.random.default_rng(9)
    xyz = rng.normal(size=(7, len(known), 3))
    turn = Rotation.random(7, random_state=9).as_matrix()
    turned = xyz @ turn.transpose(0, 2, 1) + rng.normal(size=(7, 1, 3))
    facing = to_body_axes(xyz, known)
    np.testing.assert_allclose(to_body_axes(turned, known), facing, atol=1e-9)
    assert not facing[:, 0].any()
    np.testing.assert_allclose(facing[:, 1, [0, 2]], 0, atol=1e-9)
    assert (facing[:, 1, 1] > 0).all()
    np.testing.assert_allclose(np.linalg.det(body_axes(xyz, known)), 1)
    np.testing.assert_allclose(mirrored(mirrored(xyz, known), known), xyz)
    # The mirror image faces the front as well: mirroring and turning to body axes commute.
    np.testing.assert_allclose(
        to_body_axes(mirrored(xyz, known), known), mirrored(facing, known), atol=1e-9
    )


def test_similarity_recovers_a_planted_one_and_never_reflects() -> None:
    rng = np.random.default_rng(10)
    a = rng.normal(size=(4, 3, J, 3))
    turn = Rotation.random(12, random_state=10).as_matrix().reshape(4, 3, 3, 3)
    b = 2.5 * a @ np.swapaxes(turn, -1, -2) + rng.normal(size=(4, 3, 1, 3))
    rotation, scale = similarity(a, b)
    np.testing.assert_allclose(rotation, turn, atol=1e-9)
    np.testing.assert_allclose(scale, 2.5)
    rotation, scale = similarity(a, a * [-1, 1, 1])
    np.testing.assert_allclose(np.linalg.det(rotation), 1)
    assert (scale < 1).all()
