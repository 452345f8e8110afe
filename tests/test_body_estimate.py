"""Bone lengths from a track: planted bodies found, the prior only where the track is silent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dance2pose.body import Body, body_bones_mm
from dance2pose.body_variation import SPREAD, log_covariance
from dance2pose.lifting.temporal.body_estimate import (
    Measured,
    estimate,
    from_depths,
    from_network,
)
from dance2pose.mocap.bodies import variations
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

TREE = get("cmu17")
USUAL = body_bones_mm("cmu17")
PAIR = np.array(TREE.mirror[1:]) - 1
BONES = len(USUAL)


def a_person(seed: int) -> FloatArray:
    """Bone lengths (B,) of somebody, left and right nearly alike, of the one body's sum."""
    rng = np.random.default_rng(seed)
    logs = rng.multivariate_normal(np.zeros(BONES), log_covariance())
    lengths = USUAL * np.exp(logs)
    return np.asarray(lengths * USUAL.sum() / lengths.sum())


def turning_bones(lengths: FloatArray, frames: int, seed: int) -> FloatArray:
    """Bones (N, B, 3) of these lengths that point anywhere."""
    direction = np.random.default_rng(seed).normal(size=(frames, len(lengths), 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(direction * lengths[:, None])


def at(frames: int, rate_hz: float = 2.0) -> FloatArray:
    return np.arange(frames) / rate_hz


def measured_of(bone: FloatArray, depth_sigma: float, noise: float) -> Measured:
    shape = bone.shape[:2]
    return from_depths(
        bone, np.full(shape, depth_sigma**2), np.full(shape, noise**2), at(len(bone)), USUAL
    )


def test_a_planted_body_is_found_from_exact_depths() -> None:
    lengths = a_person(1)
    measured = measured_of(turning_bones(lengths, 60, 2), 1.0, 0.5)
    np.testing.assert_allclose(np.exp(measured.log_length) * USUAL, lengths, rtol=0.002)
    body, unit = estimate([measured], "cmu17")
    np.testing.assert_allclose(body.lengths_mm, lengths, rtol=0.03)
    assert unit == pytest.approx(1.0, abs=0.02)


def test_depths_of_which_end_is_not_known_do_not_shorten_bones() -> None:
    lengths = a_person(3)
    bone = turning_bones(lengths, 400, 4)
    # A network that cannot tell which end is nearer says zero, and that it does not know.
    unsure = np.random.default_rng(5).random(bone.shape[:2]) < 0.8
    sigma = np.where(unsure, np.abs(bone[..., 2]), 2.0)
    bone[..., 2] = np.where(unsure, 0.0, bone[..., 2])
    measured = from_depths(bone, sigma**2, np.full(sigma.shape, 1.0), at(400), USUAL)
    shortened = np.log(np.median(np.linalg.norm(bone, axis=-1), axis=0) / lengths)
    off = measured.log_length - np.log(lengths / USUAL)
    assert shortened.mean() < -0.02
    assert np.abs(off).max() < 0.01


def test_noise_of_the_picture_does_not_lengthen_bones() -> None:
    lengths = a_person(6)
    bone = turning_bones(lengths, 600, 7)
    long = lengths > 150
    bone[..., :2] += np.random.default_rng(8).normal(0, 25.0, (*bone.shape[:2], 2))
    counted = measured_of(bone, 5.0, 25.0).log_length - np.log(lengths / USUAL)
    ignored = measured_of(bone, 5.0, 0.5).log_length - np.log(lengths / USUAL)
    assert np.abs(counted[long].mean()) < 0.015
    assert np.abs(counted[long].mean()) < ignored[long].mean()


def test_the_prior_remains_where_the_track_is_silent_and_only_there() -> None:
    lengths = a_person(9)
    bone = turning_bones(lengths, 80, 10)
    silent = [TREE.index(j) - 1 for j in ("left_toe", "right_toe", "head")]
    bone[:, silent] = np.nan
    body, _ = estimate([measured_of(bone, 1.0, 0.5)], "cmu17")
    told = [b for b in range(BONES) if b not in silent]
    ratio = body.lengths_mm[told] / lengths[told]
    np.testing.assert_allclose(ratio / ratio.mean(), 1.0, atol=0.03)
    assert (body.spread[told] < 0.03).all()
    assert (body.spread[silent] > 0.8 * SPREAD[silent]).all()
    np.testing.assert_allclose(body.lengths_mm[silent[0]], body.lengths_mm[silent[1]])


def test_one_side_tells_the_other() -> None:
    lengths = a_person(11)
    left_arm = [TREE.index("left_elbow") - 1, TREE.index("left_wrist") - 1]
    lengths[left_arm] *= 0.85
    lengths[PAIR[left_arm]] = lengths[left_arm]
    bone = turning_bones(lengths, 80, 12)
    bone[:, PAIR[left_arm]] = np.nan
    body, _ = estimate([measured_of(bone, 1.0, 0.5)], "cmu17")
    np.testing.assert_allclose(
        body.lengths_mm[PAIR[left_arm]], body.lengths_mm[left_arm], rtol=0.01
    )
    assert (body.spread[PAIR[left_arm]] > body.spread[left_arm]).all()


def test_a_body_known_before_stands_in_for_what_people_are_like() -> None:
    lengths = a_person(13)
    lengths[TREE.index("head") - 1] *= 1.3
    lengths *= USUAL.sum() / lengths.sum()
    nothing = Measured(np.full(BONES, np.nan), np.full(BONES, np.inf))
    known = Body("cmu17", lengths, np.full(BONES, 0.02))
    body, _ = estimate([nothing], "cmu17", known)
    np.testing.assert_allclose(body.lengths_mm, lengths, rtol=1e-6)
    usual, _ = estimate([nothing], "cmu17")
    np.testing.assert_allclose(usual.lengths_mm, USUAL, rtol=1e-6)


@given(st.floats(0.05, 20.0), st.integers(0, 50))
def test_the_unit_of_the_measurements_does_not_matter(factor: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = Measured(rng.normal(0, 0.1, BONES), rng.uniform(0.01, 0.1, BONES))
    body, unit = estimate([one], "cmu17")
    other, larger = estimate([Measured(one.log_length + np.log(factor), one.sigma)], "cmu17")
    np.testing.assert_allclose(other.lengths_mm, body.lengths_mm, rtol=1e-6)
    assert larger / unit == pytest.approx(factor, rel=1e-6)


@given(st.integers(0, 50))
def test_a_mirrored_body_is_measured_mirrored(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = Measured(rng.normal(0, 0.1, BONES), rng.uniform(0.01, 0.1, BONES))
    body, _ = estimate([one], "cmu17")
    other, _ = estimate([Measured(one.log_length[PAIR], one.sigma[PAIR])], "cmu17")
    np.testing.assert_allclose(other.lengths_mm, body.lengths_mm[PAIR], rtol=1e-9)
    np.testing.assert_allclose(other.spread, body.spread[PAIR], rtol=1e-9)


def test_frames_that_agree_by_the_network_are_no_surer_than_one() -> None:
    predicted = np.random.default_rng(14).normal(0, 0.05, BONES)
    few = from_network(np.tile(predicted, (3, 1)), np.full((3, BONES), 0.04))
    many = from_network(np.tile(predicted, (300, 1)), np.full((300, BONES), 0.04))
    np.testing.assert_allclose(few.log_length, predicted)
    np.testing.assert_allclose(few.sigma, many.sigma)


def test_a_wrist_taken_for_something_else_for_a_while_makes_no_long_forearm() -> None:
    lengths = a_person(15)
    bone = turning_bones(lengths, 200, 16)
    wrist = TREE.index("left_wrist") - 1
    bone[:50, wrist] *= 2.5
    measured = measured_of(bone, 5.0, 2.0)
    assert np.exp(measured.log_length[wrist]) * USUAL[wrist] < 1.1 * lengths[wrist]


def test_the_prediction_of_the_network_stands_in_where_depths_are_silent() -> None:
    predicted = Measured(
        np.linspace(-0.1, 0.1, BONES)[np.minimum(np.arange(BONES), PAIR)], np.full(BONES, 0.03)
    )
    nothing = Measured(np.full(BONES, np.nan), np.full(BONES, np.inf))
    body, _ = estimate([nothing], "cmu17", predicted=predicted)
    ratio = np.log(body.lengths_mm / USUAL) - predicted.log_length
    assert np.ptp(ratio) < 1e-9
    lengths = a_person(17)
    surer = Measured(np.log(lengths / USUAL), np.full(BONES, 0.003))
    body, _ = estimate([surer], "cmu17", predicted=predicted)
    np.testing.assert_allclose(body.lengths_mm, lengths, rtol=0.01)


def test_bodies_that_are_drawn_vary_as_the_prior_says() -> None:
    drawn = np.log(variations(np.random.default_rng(18), 40000))
    np.testing.assert_allclose(np.cov(drawn.T), log_covariance(), atol=4e-4)
