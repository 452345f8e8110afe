"""Which end of a bone is nearer: what neighbours tell, and the depths that follow."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal import depth_signs
from dance2pose.lifting.temporal.depth_signs import settle_depths
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

TREE = get("body17")
USUAL = body_bones_mm("body17")
PARENTS, CHILDREN = np.array(TREE.bones).T


def counted(evidence: FloatArray, flip: FloatArray) -> FloatArray:
    """Log odds (T,) of one state of two in every frame: all sequences of states counted."""
    states = np.array(list(product([0, 1], repeat=len(evidence))))
    likely = np.exp(states @ evidence)
    for t, changes in enumerate(flip):
        likely *= np.where(states[:, t] == states[:, t + 1], 1 - changes, changes)
    nearer = np.array([likely[states[:, t] == 1].sum() for t in range(len(evidence))])
    return np.asarray(np.log(nearer / (likely.sum() - nearer)))


@pytest.mark.parametrize("sure", [0.1, 1.0, 10.0])
def test_neighbours_tell_what_counting_all_sequences_tells(sure: float) -> None:
    rng = np.random.default_rng(0)
    evidence = sure * rng.normal(size=(7, 3))
    flip = rng.uniform(0, 0.5, (6, 3)) ** 3
    before, after = depth_signs._of_neighbours(evidence, flip)
    expected = [counted(*one) for one in zip(evidence.T, flip.T, strict=True)]
    np.testing.assert_allclose((before + evidence + after).T, expected, rtol=1e-9)
    assert (before[0] == 0).all() and (after[-1] == 0).all()


def test_evidence_without_end_stays_finite_where_nothing_can_change() -> None:
    before, after = depth_signs._of_neighbours(np.full((7, 2), 1e4), np.zeros((6, 2)))
    assert np.isfinite(before).all() and np.isfinite(after).all()
    assert before[-1].min() > 20 and after[0].min() > 20
    one, none = depth_signs._of_neighbours(np.ones((1, 2)), np.zeros((0, 2)))
    assert (one == 0).all() and (none == 0).all()


def test_depths_are_those_of_dense_least_squares() -> None:
    rng = np.random.default_rng(1)
    predicted, variance = rng.normal(0, 200, (7, 17)), rng.uniform(1, 1e4, (7, 17))
    step, step_variance = rng.normal(0, 200, (7, 16)), 10 ** rng.uniform(-2, 4, (7, 16))
    found, left = depth_signs._depths(predicted, variance, step, step_variance, TREE)
    ends = np.zeros((16, 17))
    ends[np.arange(16), CHILDREN], ends[np.arange(16), PARENTS] = 1, -1
    for t in range(7):
        own, tie = np.diag(0.25 / variance[t]), np.diag(1 / step_variance[t])
        inverse = np.linalg.inv(own + ends.T @ tie @ ends)
        expected = inverse @ (own @ predicted[t] + ends.T @ tie @ step[t])
        np.testing.assert_allclose(found[t], expected, rtol=1e-8)
        np.testing.assert_allclose(left[t], np.diag(inverse), rtol=1e-8)


def test_frames_that_know_settle_a_bone_for_those_that_do_not() -> None:
    frames, elbow, wrist = 30, TREE.index("left_elbow"), TREE.index("left_wrist")
    xyz = np.zeros((frames, 17, 3))
    for bone, (parent, child) in enumerate(TREE.bones):
        xyz[:, child] = xyz[:, parent] + USUAL[bone] * np.array([0.8, 0.0, 0.6])
    apart = 0.6 * USUAL[elbow - 1]
    xyz[15:, [elbow, wrist], 2] -= apart  # these say: it lies across the view

    def told(rows: slice) -> FloatArray:
        sigma, some = np.full((frames, 17), 20.0)[rows], xyz[rows]
        time_s = np.arange(len(some)) / 30
        depths, _, _ = settle_depths(some, sigma, np.ones_like(sigma), time_s, TREE, USUAL)
        return np.asarray(depths[:, elbow] - depths[:, TREE.parents[elbow]])

    assert (told(slice(0, 30))[15:] > 0.5 * apart).all()
    assert (np.abs(told(slice(15, 30))) < 0.2 * apart).all()
