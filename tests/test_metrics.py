"""Measures of poses: each recovers what was planted, and ignores what it should ignore."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dance2pose.evaluation import metrics
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

T, J = 7, 17


def poses(seed: int = 0, frames: int = T) -> FloatArray:
    return np.random.default_rng(seed).normal(0, 300, (frames, J, 3))


def wave(frames: int = 400, seed: int = 0) -> FloatArray:
    """Smooth motion (frames, J, 3): each coordinate a few slow waves."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None, None]
    waves = [
        rng.uniform(20, 80, (J, 3))
        * np.sin(2 * np.pi * t / rng.uniform(60, 160) + rng.uniform(0, 6, (J, 3)))
        for _ in range(3)
    ]
    total: FloatArray = np.sum(waves, axis=0)
    return total


@settings(max_examples=30, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    scale=st.floats(0.01, 100),
    shift=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
)
def test_alignment_undoes_any_similarity(
    turn: tuple[float, ...], scale: float, shift: tuple[float, ...]
) -> None:
    truth = poses()
    rotation = Rotation.from_rotvec(turn).as_matrix()
    moved = scale * truth @ rotation.T + np.array(shift)
    assert metrics.pa_errors(moved, truth).max() < 1e-5
    assert metrics.pa_errors(moved, truth, reflection=True).max() < 1e-5


def test_reflection_is_undone_only_where_it_is_allowed() -> None:
    truth = poses()
    mirrored = truth * [1.0, 1.0, -1.0]
    assert metrics.pa_errors(mirrored, truth, reflection=True).max() < 1e-9
    assert metrics.pa_errors(mirrored, truth).mean() > 50


def test_alignment_of_each_frame_is_the_best_that_a_search_finds() -> None:
    truth, estimate = poses(1)[:2], poses(2)[:2]
    aligned = metrics.procrustes_aligned(estimate, truth)
    rng = np.random.default_rng(3)
    for frame in range(2):
        goal = truth[frame] - truth[frame].mean(axis=0)
        moving = estimate[frame] - estimate[frame].mean(axis=0)
        ours = np.square(aligned[frame] - truth[frame]).sum()
        for rotation in Rotation.random(3000, random_state=rng).as_matrix():
            turned = moving @ rotation.T
            scale = max((turned * goal).sum() / np.square(turned).sum(), 0)
            assert ours <= np.square(scale * turned - goal).sum() + 1e-6


def test_frames_that_were_not_lifted_stay_out() -> None:
    truth = poses()
    estimate = truth.copy()
    estimate[2, 5] = np.nan
    errors = metrics.joint_errors(estimate, truth)
    assert np.isnan(errors[2]).all()
    assert (errors[[0, 1, 3, 4, 5, 6]] == 0).all()
    assert np.isnan(metrics.pa_errors(estimate, truth)[2]).all()
    assert metrics.mean_over(errors).max() == 0
    assert metrics.lifted(estimate).tolist() == [True, True, False, True, True, True, True]
    nothing = np.full_like(truth, np.nan)
    assert np.isnan(metrics.pa_errors(nothing, truth)).all()
    assert np.isnan(metrics.mean_over(metrics.pa_errors(nothing, truth))).all()


def test_alignment_of_a_pose_in_one_point_is_not_a_crash() -> None:
    truth = poses()
    errors = metrics.pa_errors(np.zeros_like(truth), truth)
    centre = truth - truth.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(errors, np.linalg.norm(centre, axis=-1))


def test_acceleration_and_jerk_of_a_known_motion() -> None:
    rate = 50.0
    t = np.arange(T) / rate
    xyz = np.zeros((T, J, 3))
    xyz[..., 1] = (7.0 * t**3)[:, None]  # third derivative 42, second 42 t
    assert metrics.jerk(xyz, rate) == pytest.approx(42.0)
    still = np.zeros_like(xyz)
    expected = np.mean([42.0 * i / rate for i in range(1, T - 1)])
    assert metrics.acceleration_error(xyz, still, rate) == pytest.approx(expected)
    assert np.isnan(metrics.jerk(xyz[:3], rate))
    assert np.isnan(metrics.acceleration_error(xyz[:2], still[:2], rate))


@pytest.mark.parametrize("late", [-3, 0, 1, 4, 11])
def test_a_planted_lag_is_measured(late: int) -> None:
    motion = wave(500)
    truth, estimate = motion[40:440], motion[40 - late : 440 - late]
    noise = np.random.default_rng(0).normal(0, 5, estimate.shape)
    assert metrics.lag_frames(estimate + noise, truth) == pytest.approx(late, abs=0.2)


def test_a_lag_of_half_a_frame_is_measured() -> None:
    motion = wave(800)
    truth, estimate = motion[100:700:2], motion[99:699:2]
    assert metrics.lag_frames(estimate, truth) == pytest.approx(0.5, abs=0.1)


def test_lag_of_what_cannot_have_one_is_unknown() -> None:
    truth = wave(200)
    assert np.isnan(metrics.lag_frames(truth[:40], truth[:40]))
    assert np.isnan(metrics.lag_frames(np.zeros_like(truth), truth))
    assert np.isnan(metrics.lag_frames(np.full_like(truth, np.nan), truth))
    gap = truth.copy()
    gap[30] = np.nan
    assert metrics.lag_frames(gap, truth) == pytest.approx(0, abs=0.05)


def test_bone_length_range_is_that_of_the_bone_that_changes_most() -> None:
    skeleton = get("cmu17")
    xyz = np.repeat(poses()[:1], T, axis=0)
    assert metrics.bone_length_range(xyz, skeleton) == pytest.approx(0)
    wrist, elbow = skeleton.index("left_wrist"), skeleton.index("left_elbow")
    bone = xyz[3, wrist] - xyz[3, elbow]
    xyz[3, wrist] += 20 * bone / np.linalg.norm(bone)
    xyz[4, wrist] -= 5 * bone / np.linalg.norm(bone)
    assert metrics.bone_length_range(xyz, skeleton) == pytest.approx(25)


def test_calibration_of_errors_of_known_size() -> None:
    sigma = np.full((1000, J), 2.0)
    errors = np.abs(np.random.default_rng(0).normal(0, 2, (1000, J)))
    one, two = metrics.within_sigma(errors, sigma)
    assert one == pytest.approx(0.683, abs=0.01)
    assert two == pytest.approx(0.954, abs=0.01)
    errors[:, 0] = np.nan
    assert metrics.within_sigma(errors, sigma)[0] == pytest.approx(0.683, abs=0.01)
    assert np.isnan(metrics.within_sigma(errors * np.nan, sigma)[0])


def test_foot_slide_counts_steps_between_frames_of_contact_only() -> None:
    feet = np.zeros((T, 2, 3))
    feet[:, 0, 0] = [0, 3, 6, 100, 200, 200, 200]
    contact = np.zeros((T, 2), bool)
    contact[:3, 0] = True  # two steps of 3 mm
    contact[5:, 1] = True  # one step of 0 mm
    assert metrics.foot_slide(feet, contact) == pytest.approx(2.0)
    assert np.isnan(metrics.foot_slide(feet, np.zeros_like(contact)))


def test_true_contacts_are_slow_and_low() -> None:
    feet = np.zeros((60, 2, 3))
    feet[:, 1, 1] = 400.0  # held up
    feet[30:, 0, 0] = np.arange(30) * 40.0  # slides away at 1.2 m/s
    contact = metrics.true_contacts(feet, 30.0)
    assert contact[:29, 0].all()
    assert not contact[31:, 0].any()
    assert not contact[:, 1].any()


@pytest.mark.parametrize("snr", [1.0, 17.0, 40.0])
def test_noise_has_the_ratio_asked_for(snr: float) -> None:
    xy = wave(300)[..., :2]
    xy -= xy[:, :1]
    sigma = metrics.signal_to_noise_sigma(xy, snr)
    noise = np.random.default_rng(0).normal(0, sigma, xy.shape)
    measured = 10 * np.log10(np.mean(xy[:, 1:] ** 2) / np.mean(noise**2))
    assert measured == pytest.approx(snr, abs=0.2)


def test_measures_need_no_plotting_library() -> None:
    code = (
        "import sys; sys.modules['matplotlib'] = None; sys.modules['onnxruntime'] = None; "
        "import dance2pose.evaluation.metrics"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
