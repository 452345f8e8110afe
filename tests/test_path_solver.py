"""The dancer's path: planted walks recovered from bad distances, by feet and by the floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.lifting.world.path_solver import Floor, solve_path
from dance2pose.poses import BoolArray, FloatArray

T, DIP_DEG = 90, 30.0
TIME_S = np.arange(T) / 30
UP = np.array([0.0, np.cos(np.radians(DIP_DEG)), np.sin(np.radians(DIP_DEG))])  # camera looks down
AWAY = np.array([0.0, UP[2], -UP[1]])
ANKLE = -2600.0  # of standing ankles, along UP, from the camera


def walk() -> tuple[FloatArray, FloatArray, BoolArray]:
    """Path (T, 3), ankles (T, 2, 3) relative to it, and which of them stand: steps to the back."""
    stride, step = 300.0, 15  # mm, frames
    way = stride * np.arange(T) / step
    path = (ANKLE + 850) * UP + (4000 + way)[:, None] * AWAY
    path[:, 0] += 200 * np.sin(np.arange(T) / 20)
    contact = np.zeros((T, 2), bool)
    feet = np.zeros((T, 2, 3))
    for t in range(T):
        number = t // step
        for foot in range(2):
            stands = number % 2 == foot
            contact[t, foot] = stands
            at = 4000 + stride * (number + 0.5)
            place = (ANKLE + (0 if stands else 80)) * UP + at * AWAY + [[-90, 90][foot], 0, 0]
            feet[t, foot] = place - path[t]
    return path, feet, contact


def seen_badly(path: FloatArray, size: float = 120.0) -> FloatArray:
    """Right in the picture, slowly wrong along the line of sight."""
    along = path / np.linalg.norm(path, axis=1, keepdims=True)
    return path + size * np.sin(np.arange(T) / 14.0)[:, None] * along


def test_the_floor_tells_the_distance() -> None:
    path, feet, contact = walk()
    seen = seen_badly(path)
    contact &= (np.arange(T) % 2 == 0)[:, None]  # never two frames long: nothing to slide
    alone = solve_path(seen, feet, contact, TIME_S)
    floored = solve_path(seen, feet, contact, TIME_S, floor=Floor(UP, ANKLE, 10.0))

    def error(found: FloatArray) -> float:
        return float(np.linalg.norm(found - path, axis=1).mean())

    assert error(floored) < 0.6 * error(alone)
    assert error(alone) < 1.05 * error(seen)
    ankles = floored[:, None] + feet
    assert np.abs((ankles @ UP)[contact] - ANKLE).max() < 15  # mm, as asked of standing feet


def test_standing_feet_do_not_slide() -> None:
    path, feet, contact = walk()
    found = solve_path(seen_badly(path), feet, contact, TIME_S, floor=Floor(UP, ANKLE, 10.0))
    moved = np.linalg.norm(np.diff(found[:, None] + feet, axis=0), axis=-1)
    both = contact[1:] & contact[:-1]
    assert moved[both].mean() < 1.0


def test_no_foot_stays_below_the_floor() -> None:
    path, feet, contact = walk()
    low = feet.copy()
    low[40:50] -= 100 * UP  # a pose that reaches too far down
    least = -(low @ UP).min(axis=1)
    floor = Floor(UP, ANKLE, 10.0)
    stands = contact & (np.arange(T) < 38)[:, None]
    sunk = solve_path(path, low, stands, TIME_S, floor=floor)
    found = solve_path(path, low, stands, TIME_S, floor=floor, least=least)
    assert ((sunk[:, None] + low) @ UP - ANKLE).min() < -60
    assert ((found[:, None] + low) @ UP - ANKLE).min() > -15
    assert np.abs(found - path)[:30].max() < 40


def test_what_is_right_stays_right_and_two_frames_are_left_alone() -> None:
    path, feet, contact = walk()
    found = solve_path(path, feet, contact, TIME_S, floor=Floor(UP, ANKLE, 10.0))
    np.testing.assert_allclose(found, path, atol=6.0)
    np.testing.assert_array_equal(solve_path(path[:2], feet[:2], contact[:2], TIME_S[:2]), path[:2])


@settings(max_examples=15, deadline=None)
@given(st.floats(0.3, 3.0), st.integers(0, 99))
def test_the_solution_turns_with_the_world(turn: float, seed: int) -> None:
    path, feet, contact = walk()
    seen = seen_badly(path) + np.random.default_rng(seed).normal(0, 20, path.shape)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    floor, turned = Floor(UP, ANKLE, 10.0), Floor(rotation @ UP, ANKLE, 10.0)
    one = solve_path(seen, feet, contact, TIME_S, floor=floor)
    other = solve_path(seen @ rotation.T, feet @ rotation.T, contact, TIME_S, floor=turned)
    np.testing.assert_allclose(other, one @ rotation.T, atol=1e-4)


@pytest.mark.parametrize("rows", [3, 5])
def test_short_stretches_are_solved(rows: int) -> None:
    path, feet, contact = walk()
    found = solve_path(path[:rows], feet[:rows], contact[:rows], TIME_S[:rows])
    np.testing.assert_allclose(found, path[:rows], atol=3.0)
