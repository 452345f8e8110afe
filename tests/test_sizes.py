"""Sizes of figures: planted ones found, a dancer's way told from errors."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.body import Body, body_bones_mm
from dance2pose.lifting.pursuit.dictionary import load
from dance2pose.lifting.temporal.apparent_size import (
    SIZE_ERROR,
    growth,
    size_errors,
    sizes,
    sizes_of_body,
)
from dance2pose.skeleton import get

BODY = body_bones_mm("cmu17")
TIMES = np.arange(90) / 30.0
SURE = size_errors(np.full((90, 17), 20.0))


def test_the_size_of_a_body_is_that_of_its_bones() -> None:
    mean = load("cmu17").mean
    upright = np.repeat(mean[None], 3, axis=0) * np.array([0.5, 1.0, 1.7])[:, None, None]
    found = sizes(upright, get("cmu17"), BODY)
    np.testing.assert_allclose(found / found[1], [0.5, 1.0, 1.7])
    assert found[1] == pytest.approx(1.0, abs=0.1)


def test_depths_that_are_too_small_do_not_make_a_figure_smaller_than_it_looks() -> None:
    tree = get("cmu17")
    flat = np.zeros((1, 17, 3))
    for bone, (parent, child) in enumerate(tree.bones):
        flat[0, child] = flat[0, parent] + [0.0, BODY[bone] if bone % 2 else 0.3 * BODY[bone], 0.0]
    assert sizes(flat, tree, BODY)[0] == pytest.approx(1.0)  # half of the bones are at full length


def test_the_way_to_the_camera_is_found_through_errors() -> None:
    rng = np.random.default_rng(5)
    way = np.exp(0.2 * np.sin(0.8 * TIMES))
    found = growth(way * np.exp(rng.normal(0, SIZE_ERROR, 90)), SURE, [np.arange(90)], TIMES)
    true = way / np.median(way)
    assert np.abs(np.log(found / true)).mean() < 0.6 * SIZE_ERROR


def test_errors_alone_are_no_way_and_size_itself_does_not_matter() -> None:
    rng = np.random.default_rng(6)
    errors = np.exp(rng.normal(0, SIZE_ERROR, 90))
    parts = [np.arange(40), np.arange(40, 90)]
    np.testing.assert_array_equal(growth(errors, SURE, parts, TIMES), 1.0)
    way = np.exp(0.3 * np.sin(TIMES))
    np.testing.assert_allclose(
        growth(way, SURE, parts, TIMES), growth(250 * way, SURE, parts, TIMES), rtol=1e-9
    )


def test_frames_that_the_network_doubts_count_less() -> None:
    way = np.exp(0.2 * np.sin(0.8 * TIMES))
    seen, doubt = way.copy(), SURE.copy()
    seen[40:46] *= 1.5
    fooled = growth(seen, doubt, [np.arange(90)], TIMES)
    doubt[40:46] = size_errors(np.full((6, 17), 200.0))
    warned = growth(seen, doubt, [np.arange(90)], TIMES)
    true = way / np.median(way)
    assert np.abs(warned - true).max() < 0.5 * np.abs(fooled - true).max()


def bones_of_a_body(lengths: np.ndarray, frames: int) -> np.ndarray:
    """(N, B, 3) bones of these lengths in any directions."""
    direction = np.random.default_rng(8).standard_normal((frames, len(lengths), 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.asarray(direction * lengths[:, None])


def test_the_size_of_a_known_body_does_not_depend_on_which_bones_are_seen() -> None:
    lengths = BODY * np.exp(0.1 * np.sin(np.arange(16)))  # not the one body
    body, size = Body("cmu17", lengths, np.full(16, 0.01)), np.array([0.7, 1.0, 1.3, 1.0, 2.0])
    bone = bones_of_a_body(lengths, 5) * size[:, None, None]
    bone[0, 3:] = bone[1, :9] = bone[2, ::2] = np.nan
    found, error = sizes_of_body(bone, np.full((5, 16), 1.0), 0.0, body)
    np.testing.assert_allclose(found, size, rtol=2e-3)
    assert error[0] > error[3]


def test_a_bone_that_was_seen_wrongly_hardly_changes_the_size() -> None:
    body = Body("cmu17", BODY, np.full(16, 0.01))
    bone = bones_of_a_body(BODY, 4)
    bone[:, 5] *= 1.6
    found, _ = sizes_of_body(bone, np.full((4, 16), 100.0), 2.0, body)
    assert np.abs(found - 1).max() < 0.01


def test_a_frame_that_shows_no_bone_says_nothing_of_the_size() -> None:
    bone = np.full((2, 16, 3), np.nan)
    bone[0] = bones_of_a_body(BODY, 1)[0]
    body = Body("cmu17", BODY, np.full(16, 0.01))
    found, error = sizes_of_body(bone, np.full((2, 16), 9.0), 1.0, body)
    assert np.isfinite(found).all()
    assert error[1] >= 1.0 > 0.02 > error[0]
