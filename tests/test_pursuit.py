"""The pursuit: planted poses, invariances, and a slow, plain reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from dance2pose.body import body_bones_mm
from dance2pose.errors import UsageError
from dance2pose.lifting.pursuit import pursue as pursuit
from dance2pose.lifting.pursuit.anthropometric import constrained_least_squares
from dance2pose.lifting.pursuit.camera import rotation_from_vector
from dance2pose.lifting.pursuit.dictionary import Dictionary, load
from dance2pose.lifting.pursuit.greedy import CAMERA_STEPS
from dance2pose.lifting.pursuit.pursue import PursuitSettings, pursue
from dance2pose.poses import BoolArray, FloatArray, IntArray

PLAIN = PursuitSettings(
    atoms=6, tolerance=0.0, ridge=0.0, anthropometric=False, start_atoms=0, tries=1
)


def random_dictionary(atoms: int = 40, seed: int = 0) -> Dictionary:
    """Incoherent atoms about the mean pose of cmu17."""
    rng = np.random.default_rng(seed)
    made_up = rng.normal(size=(atoms, 17, 3))
    made_up[:, 0] = 0
    made_up /= np.linalg.norm(made_up, axis=(1, 2), keepdims=True)
    return Dictionary("cmu17", made_up, load("cmu17").mean, body_bones_mm("cmu17"), {})


def turns(count: int, seed: int, degrees: float = 180) -> FloatArray:
    """Rotations by less than `degrees` about random axes."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(count, 3))
    axis *= rng.uniform(0, np.radians(degrees), (count, 1)) / np.linalg.norm(
        axis, axis=1, keepdims=True
    )
    return rotation_from_vector(axis)


def seen(body: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Observations (N, J, 3) of poses in body axes, off the origin."""
    turned: FloatArray = scale[:, None, None] * (body @ rotation.transpose(0, 2, 1))
    return turned + np.array([100.0, -50.0, 20.0])


def planar(shape: tuple[int, int]) -> FloatArray:
    weights = np.ones((*shape, 3))
    weights[..., 2] = 0
    return weights


def corpus_poses(count: int, seed: int = 3) -> FloatArray:
    """Poses of a few atoms each of the dictionary that comes with the project."""
    dictionary = load("cmu17")
    rng = np.random.default_rng(seed)
    active = np.array([rng.choice(len(dictionary), 4, replace=False) for _ in range(count)])
    return dictionary.pose(active, rng.normal(size=(count, 4)) * 200)


@pytest.mark.parametrize("depth", [False, True])
def test_planted_sparse_poses_are_recovered(depth: bool) -> None:
    """Three atoms each, seen by cameras near the given start: atoms, coefficients, pose, camera."""
    dictionary = random_dictionary()
    rng = np.random.default_rng(1)
    frames = 30
    active = np.array([rng.choice(40, 3, replace=False) for _ in range(frames)])
    w = rng.choice([-1, 1], (frames, 3)) * rng.uniform(150, 300, (frames, 3))
    body, rotation = dictionary.pose(active, w), turns(frames, 2)
    scale = rng.uniform(0.2, 2, frames)
    weights = np.ones((frames, 17, 3)) if depth else planar((frames, 17))
    # Polish repeats coefficients and camera until both have settled.
    found = pursue(
        dictionary,
        seen(body, rotation, scale),
        weights,
        settings=replace(PLAIN, atoms=3, polish=400),
        rotation=rotation,
    )
    right = (np.sort(found.active, axis=1) == np.sort(active, axis=1)).all(axis=1)
    # A greedy choice may go wrong, more easily where depth is not told.
    assert right.mean() >= (0.9 if depth else 0.6)
    size = np.linalg.norm(body, axis=(1, 2))
    off = np.linalg.norm(found.body - body, axis=(1, 2)) / size
    assert off[right].max() < 1e-6
    np.testing.assert_allclose(found.camera.rotation[right], rotation[right], atol=1e-6)
    np.testing.assert_allclose(found.camera.scale[right], scale[right], rtol=1e-6)
    order = np.argsort(found.active, axis=1)
    mine = np.take_along_axis(found.coefficients, order, axis=1)
    planted = np.take_along_axis(w, np.argsort(active, axis=1), axis=1)
    np.testing.assert_allclose(mine[right], planted[right], rtol=1e-4)


def test_the_mean_pose_needs_no_atom() -> None:
    dictionary = load("body17")
    rotation = turns(4, 5)
    observed = seen(np.repeat(dictionary.mean[None], 4, axis=0), rotation, np.ones(4))
    exact = replace(PLAIN, tolerance=1e-6)
    found = pursue(dictionary, observed, planar((4, 17)), settings=exact, rotation=rotation)
    assert (found.active == -1).all() and not found.coefficients.any()
    np.testing.assert_allclose(found.camera.rotation, rotation, atol=1e-6)


def test_frames_stop_at_the_tolerance_and_at_the_number_of_atoms() -> None:
    dictionary = load("cmu17")
    observed = seen(corpus_poses(40), turns(40, 6), np.ones(40))
    weights = planar((40, 17))
    loose = replace(PLAIN, atoms=9, tolerance=0.03)
    found = pursue(dictionary, observed, weights, settings=loose)
    used = (found.active >= 0).sum(axis=1)
    assert used.min() < used.max() <= 9
    figure = observed[..., :2] - observed[..., :2].mean(axis=1, keepdims=True)
    size = np.sqrt((figure**2).sum(axis=(1, 2)) / (2 * 17))
    done = used < 9
    assert (found.residual[done] <= 0.03 * size[done] * (1 + 1e-9)).all()
    # Used atoms come first, each once; unused places hold nothing.
    for row, count in zip(found.active, used, strict=True):
        assert len(set(row[:count])) == count and (row[count:] == -1).all()
    assert not found.coefficients[found.active == -1].any()


def test_more_atoms_leave_less() -> None:
    dictionary = load("cmu17")
    observed = seen(corpus_poses(20), turns(20, 7), np.ones(20))
    residuals = [
        pursue(
            dictionary, observed, planar((20, 17)), settings=replace(PLAIN, atoms=k)
        ).residual.mean()
        for k in (0, 2, 5, 9)
    ]
    assert residuals == sorted(residuals, reverse=True) and residuals[-1] < 0.2 * residuals[0]


# --- against a slow, plain reference, one frame at a time, without any of the shortcuts ---


def reference_camera(
    xyz: FloatArray, observed: FloatArray, weights: FloatArray, rotation: FloatArray, steps: int
) -> tuple[FloatArray, float, FloatArray]:
    """Gauss-Newton on every coordinate of every joint, in rotation, scale and translation."""

    def solved(r: FloatArray) -> tuple[float, FloatArray, float]:
        """Scale, translation and cost by linear least squares for a given rotation."""
        rows, right = [], []
        for j in range(len(xyz)):
            for c in range(3):
                root = np.sqrt(weights[j, c])
                row = np.zeros(4)
                row[0] = root * (r @ xyz[j])[c]
                row[1 + c] = root
                rows.append(row)
                right.append(root * observed[j, c])
        best = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
        left = np.array(right) - np.array(rows) @ best
        return float(best[0]), best[1:], float(left @ left)

    scale, shift, cost = solved(rotation)
    for _ in range(steps):
        rows, right = [], []
        for j in range(len(xyz)):
            point = scale * rotation @ xyz[j]
            for c in range(3):
                root = np.sqrt(weights[j, c])
                unit = np.eye(3)[c]
                row = np.zeros(7)
                row[:3] = root * np.cross(point, unit)
                row[3] = root * point[c]
                row[4 + c] = root
                rows.append(row)
                right.append(root * (observed[j, c] - point[c] - shift[c]))
        step = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
        trial = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        trial_scale, trial_shift, trial_cost = solved(trial)
        if trial_cost < cost:
            rotation, scale, shift, cost = trial, trial_scale, trial_shift, trial_cost
    return rotation, scale, shift


def reference_pursuit(
    dictionary: Dictionary, observed: FloatArray, weights: FloatArray, start: FloatArray, atoms: int
) -> tuple[list[int], FloatArray, FloatArray]:
    """Active atoms, pose in body axes and rotation of one frame."""
    w = weights.ravel()
    rotation, scale, shift = reference_camera(
        dictionary.mean, observed, weights, start, CAMERA_STEPS
    )
    active: list[int] = []
    body = dictionary.mean
    for _ in range(atoms):
        left = observed - (scale * body @ rotation.T + shift)
        best, most = -1, 0.0
        for k, atom in enumerate(dictionary.atoms):
            image = atom @ rotation.T
            alike = image - image.mean(axis=0)
            alike *= np.sqrt(weights.sum(axis=0) / weights.sum(axis=0).max())
            match = abs((weights * left * image).sum()) / np.linalg.norm(alike)
            if k not in active and match > most:
                best, most = k, match
        active.append(best)
        columns = []
        for k in active:
            image = scale * dictionary.atoms[k] @ rotation.T
            for c in range(3):
                if weights[:, c].any():
                    image[:, c] -= np.average(image[:, c], weights=weights[:, c])
            columns.append(image.ravel())
        mean = scale * dictionary.mean @ rotation.T
        right = observed - mean
        for c in range(3):
            if weights[:, c].any():
                right[:, c] -= np.average(right[:, c], weights=weights[:, c])
        root = np.sqrt(w)
        solution = np.linalg.lstsq(
            root[:, None] * np.array(columns).T, root * right.ravel(), rcond=None
        )[0]
        body = dictionary.mean + np.einsum("k,kjd->jd", solution, dictionary.atoms[active])
        rotation, scale, shift = reference_camera(body, observed, weights, rotation, CAMERA_STEPS)
    return active, body, rotation


def test_against_a_slow_plain_reference_on_50_poses() -> None:
    dictionary = random_dictionary(atoms=60, seed=8)
    frames = 50
    rng = np.random.default_rng(9)
    rotation = turns(frames, 10)
    observed = seen(corpus_poses(frames), rotation, rng.uniform(0.3, 2, frames))
    weights = planar((frames, 17))
    weights[..., :2] = rng.uniform(0.3, 1, (frames, 17, 1))
    weights[::2, :, 2] = 0.1  # depth is told of every second frame
    start = turns(frames, 11, degrees=20) @ rotation
    found = pursue(dictionary, observed, weights, settings=replace(PLAIN, atoms=4), rotation=start)
    for n in range(frames):
        active, body, camera = reference_pursuit(
            dictionary, observed[n], weights[n], start[n], atoms=4
        )
        assert found.active[n].tolist() == active
        np.testing.assert_allclose(found.body[n], body, atol=1e-3)
        np.testing.assert_allclose(found.camera.rotation[n], camera, atol=1e-6)


def test_a_frame_does_not_depend_on_its_company(monkeypatch: pytest.MonkeyPatch) -> None:
    dictionary = load("cmu17")
    observed = seen(corpus_poses(11), turns(11, 12), np.ones(11))
    weights = planar((11, 17))
    weights[3, :, 2] = 0.5
    together = pursue(dictionary, observed, weights)
    monkeypatch.setattr(pursuit, "_CHUNK", 4)
    for n in (0, 3, 10):
        alone = pursue(dictionary, observed[n : n + 1], weights[n : n + 1])
        assert alone.active[0].tolist() == together.active[n].tolist()
        np.testing.assert_allclose(alone.body[0], together.body[n], atol=1e-6)
    in_chunks = pursue(dictionary, observed, weights)
    np.testing.assert_allclose(in_chunks.body, together.body, atol=1e-6)


# --- what must not matter ---


@settings(max_examples=15, deadline=None)
@given(
    st.floats(0.05, 20),
    st.floats(-5000, 5000),
    st.floats(-5000, 5000),
    st.floats(-np.pi, np.pi),
)
def test_place_size_and_turn_of_the_image_do_not_matter(
    size: float, x: float, y: float, turn: float
) -> None:
    dictionary = load("body17")
    observed = seen(corpus_poses(5), turns(5, 13), np.ones(5))
    roll = Rotation.from_euler("z", turn).as_matrix()
    moved = size * observed @ roll.T + np.array([x, y, 0])
    before = pursue(dictionary, observed, planar((5, 17)))
    after = pursue(dictionary, moved, planar((5, 17)))
    assert (before.active == after.active).all()
    np.testing.assert_allclose(after.xyz, before.xyz @ roll.T, atol=0.01)
    np.testing.assert_allclose(after.residual, size * before.residual, rtol=1e-3)


def test_the_weight_of_a_joint_is_how_much_it_counts() -> None:
    dictionary = load("cmu17")
    observed = seen(corpus_poses(6), turns(6, 14), np.ones(6))
    wrong = observed.copy()
    wrong[:, 4, :2] += 400
    weights = planar((6, 17))
    light = weights.copy()
    light[:, 4] *= 1e-9
    none = weights.copy()
    none[:, 4] = 0
    nan = wrong.copy()
    nan[:, 4] = np.nan
    unseen = pursue(dictionary, nan, none)
    assert np.isfinite(unseen.xyz).all()
    np.testing.assert_allclose(pursue(dictionary, wrong, none).xyz, unseen.xyz)
    np.testing.assert_allclose(pursue(dictionary, wrong, light).xyz, unseen.xyz, atol=1.0)
    misled = pursue(dictionary, wrong, weights)
    assert np.abs(misled.xyz - unseen.xyz).max() > 50


def test_depth_where_it_is_told_is_followed() -> None:
    dictionary = load("cmu17")
    body, rotation = corpus_poses(30), turns(30, 15)
    observed = seen(body, rotation, np.ones(30))
    plain = replace(PLAIN, atoms=12, ridge=1e-3)
    truth = body @ rotation.transpose(0, 2, 1)

    def error(weight: float) -> float:
        weights = planar((30, 17))
        weights[..., 2] = weight
        found = pursue(dictionary, observed, weights, settings=plain).xyz
        return float(np.linalg.norm(found - truth, axis=-1).mean())

    assert error(1.0) < 0.3 * error(0.0)
    assert error(1.0) <= error(0.05) < error(0.0)


# --- limits and the anthropometric constraint ---


class NoArmAbove:
    """Made-up limits: the left hand (joint 4) must not be above the neck in body axes."""

    def is_valid(self, xyz: FloatArray) -> BoolArray:
        flags = np.ones((len(xyz), xyz.shape[1] - 1), dtype=bool)
        flags[:, 3] = xyz[:, 4, 1] <= xyz[:, 1, 1]
        return flags


def test_atoms_that_break_a_limit_are_passed_over() -> None:
    dictionary = load("cmu17")
    body = corpus_poses(40)
    observed = seen(body, turns(40, 16), np.ones(40))
    limits = NoArmAbove()
    free = pursue(dictionary, observed, planar((40, 17)))
    patient = PursuitSettings(tries=50)
    held = pursue(dictionary, observed, planar((40, 17)), limits=limits, settings=patient)
    broken = ~limits.is_valid(free.body)[:, 3]
    assert 0 < broken.sum() < 40
    assert limits.is_valid(held.body).all()
    assert (held.active[:, 0] >= 0).all()  # passed over, not given up


def test_a_frame_whose_every_atom_is_refused_keeps_the_mean_pose() -> None:
    class Nothing:
        def is_valid(self, xyz: FloatArray) -> BoolArray:
            mean = np.isclose(xyz, load("cmu17").mean).all(axis=(1, 2))
            return np.repeat(mean[:, None], 16, axis=1)

    observed = seen(corpus_poses(3), turns(3, 17), np.ones(3))
    found = pursue(load("cmu17"), observed, planar((3, 17)), limits=Nothing())
    assert (found.active == -1).all()
    assert np.isfinite(found.xyz).all()


@pytest.mark.parametrize("closed_form", [False, True])
def test_the_sum_of_squared_bone_lengths_is_held(closed_form: bool) -> None:
    dictionary = load("cmu17")
    observed = seen(corpus_poses(20), turns(20, 18), np.ones(20))
    usual = PursuitSettings(closed_form=closed_form)
    found = pursue(dictionary, observed, planar((20, 17)), settings=usual)
    total = (dictionary.bones_of(found.body) ** 2).sum(axis=1)
    np.testing.assert_allclose(total, dictionary.sum_of_squared_lengths, rtol=1e-6)
    rebuilt = dictionary.pose(np.maximum(found.active, 0), found.coefficients)
    np.testing.assert_allclose(found.growth[:, None, None] * rebuilt, found.body, atol=1e-6)
    if closed_form:
        np.testing.assert_array_equal(found.growth, 1)
    without = replace(usual, anthropometric=False)
    free = pursue(dictionary, observed, planar((20, 17)), settings=without)
    total = (dictionary.bones_of(free.body) ** 2).sum(axis=1)
    assert np.abs(total / dictionary.sum_of_squared_lengths - 1).max() > 0.05


def test_constrained_least_squares_against_a_general_optimiser() -> None:
    rng = np.random.default_rng(19)
    problems, k = 6, 4
    a, r = rng.normal(size=(problems, 9, k)), rng.normal(size=(problems, 9))
    bones, mean = rng.normal(size=(12, k)), rng.normal(size=12)
    total = 30.0
    w = constrained_least_squares(
        a.transpose(0, 2, 1) @ a,
        np.einsum("nrk,nr->nk", a, r),
        np.repeat((bones.T @ bones)[None], problems, axis=0),
        np.repeat((bones.T @ mean)[None], problems, axis=0),
        float(mean @ mean),
        total,
    )
    for n in range(problems):

        def cost(x: FloatArray, n: int = n) -> float:
            return float(((a[n] @ x - r[n]) ** 2).sum())

        def over(x: FloatArray) -> float:
            return float(((bones @ x + mean) ** 2).sum() - total)

        np.testing.assert_allclose(over(w[n]), 0, atol=1e-6)
        others = [
            minimize(cost, start, constraints={"type": "eq", "fun": over}, method="SLSQP")
            for start in 3 * rng.normal(size=(15, k))
        ]
        best = min(o.fun for o in others if o.success and abs(over(o.x)) < 1e-6)
        assert cost(w[n]) <= best + 1e-6


def test_constrained_least_squares_in_the_hard_case_and_out_of_reach() -> None:
    eye = np.eye(2)[None]
    # min 4 y^2 + x^2 - 2 * 0 over the circle of radius 2: the gradient has no part along x.
    hard = constrained_least_squares(
        np.diag([1.0, 4.0])[None], np.array([[0.0, 1.0]]), eye, np.zeros((1, 2)), 0.0, 4.0
    )
    np.testing.assert_allclose(np.abs(hard), [[np.sqrt(4 - 1 / 9), 1 / 3]], atol=1e-6)
    # |w + d|^2 >= 9 whatever w: the smallest pose is w = 0.
    smallest = constrained_least_squares(
        eye.copy(), np.array([[5.0, 5.0]]), eye, np.zeros((1, 2)), 9.0, 4.0
    )
    np.testing.assert_allclose(smallest, 0, atol=1e-4)


# --- faults ---


@pytest.mark.parametrize(
    "wrong",
    [{"atoms": -1}, {"tolerance": -0.1}, {"ridge": float("nan")}, {"tries": 0}, {"polish": -1}],
)
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        PursuitSettings(**wrong)  # type: ignore[arg-type]


def test_mismatched_shapes_are_refused() -> None:
    dictionary = load("cmu17")
    wrong = (((7, 15, 3), (7, 15, 3)), ((7, 17, 2), (7, 17, 2)), ((7, 17, 3), (5, 17, 3)))
    for shape, weights in wrong:
        with pytest.raises(ValueError, match="shape"):
            pursue(dictionary, np.zeros(shape), np.ones(weights))
    with pytest.raises(ValueError, match="finite"):
        pursue(dictionary, np.full((2, 17, 3), np.nan), np.ones((2, 17, 3)))
    with pytest.raises(ValueError, match="negative"):
        pursue(dictionary, np.zeros((2, 17, 3)), -np.ones((2, 17, 3)))


def test_no_frames_and_frames_that_show_one_point() -> None:
    dictionary = load("cmu17")
    assert pursue(dictionary, np.zeros((0, 17, 3)), np.zeros((0, 17, 3))).xyz.shape == (0, 17, 3)
    point = pursue(dictionary, np.full((2, 17, 3), 5.0), planar((2, 17)))
    assert np.isfinite(point.xyz).all()


def test_inputs_may_be_read_only_and_are_left_alone() -> None:
    observed = seen(corpus_poses(3), turns(3, 20), np.ones(3)).astype(np.float32)
    weights = planar((3, 17)).astype(np.float32)
    copies = observed.copy(), weights.copy()
    observed.flags.writeable = weights.flags.writeable = False
    pursue(load("cmu17"), observed, weights)
    np.testing.assert_array_equal(observed, copies[0])
    np.testing.assert_array_equal(weights, copies[1])


def test_more_atoms_wanted_than_there_are() -> None:
    dictionary = random_dictionary(atoms=3)
    observed = seen(corpus_poses(4), turns(4, 22), np.ones(4))
    found = pursue(dictionary, observed, planar((4, 17)), settings=replace(PLAIN, atoms=6))
    assert (np.sort(found.active[:, :3], axis=1) == [0, 1, 2]).all()
    assert (found.active[:, 3:] == -1).all()


def test_duplicated_atoms_do_no_harm() -> None:
    dictionary = load("cmu17")
    twice = replace(dictionary, atoms=np.concatenate([dictionary.atoms, dictionary.atoms]))
    observed = seen(corpus_poses(5), turns(5, 21), np.ones(5))
    found = pursue(twice, observed, planar((5, 17)))
    assert np.isfinite(found.xyz).all()
    chosen: IntArray = found.active % len(dictionary)
    assert (chosen >= 0).all()
