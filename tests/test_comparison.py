"""Two performances: planted differences of time, size, heading and pose, and faults."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dance2pose.commands.compare import compare as compare_command
from dance2pose.comparison import body_relative, compare, match
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import write_poses
from dance2pose.poses import Timeline, Track3D
from dance2pose.skeleton import get
from export_making import make_poses, with_gap
from recording_making import Recording

SKELETON = get("body17")


def performed(times: np.ndarray, clock: np.ndarray | None = None) -> Track3D:
    """The planted dance, its moment clock[t] danced at times[t]."""
    poses = make_poses(times if clock is None else clock, rooted=False)
    return dataclasses.replace(
        poses, timeline=Timeline(np.arange(len(times), dtype=np.int64), times)
    )


def brute_force(a: np.ndarray, b: np.ndarray) -> float:
    """Least cost of the symmetric form, cell by cell, without a band."""
    cost = np.linalg.norm(a[:, None] - b[None], axis=-1).mean(axis=-1)
    total = np.full((len(a), len(b)), np.inf)
    for i in range(len(a)):
        for j in range(len(b)):
            ways = [cost[0, 0]] if i == j == 0 else []
            if i and j:
                ways.append(total[i - 1, j - 1] + 2 * cost[i, j])
            if i:
                ways.append(total[i - 1, j] + cost[i, j])
            if j:
                ways.append(total[i, j - 1] + cost[i, j])
            total[i, j] = min(ways)
    return float(total[-1, -1])


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 1000))
def test_the_path_is_the_cheapest_there_is(n: int, m: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(n, 4, 3)), rng.normal(size=(m, 4, 3))
    path = match(a, b, band=2.0)
    assert path[0].tolist() == [0, 0] and path[-1].tolist() == [n - 1, m - 1]
    steps = np.diff(path, axis=0)
    assert ((steps >= 0) & (steps <= 1)).all() and (steps.sum(axis=1) >= 1).all()
    cost = np.linalg.norm(a[path[:, 0]] - b[path[:, 1]], axis=-1).mean(axis=-1)
    weight = np.concatenate([[1], steps.sum(axis=1)])
    assert (weight * cost).sum() == pytest.approx(brute_force(a, b))


def test_a_planted_change_of_tempo_is_found() -> None:
    times = np.arange(150) / 25
    # The second dances the same, but slower at first and faster then; it ends at the same time.
    clock = times**1.25 / times[-1] ** 0.25
    found = compare(performed(times), performed(times, clock))
    truth = (times * times[-1] ** 0.25) ** 0.8  # when the second reaches each moment of the first
    assert np.abs(found.time_b_s - truth)[5:-5].max() < 0.1
    whole = found.phrases[0]
    assert whole.joints[0].mean < 0.01 and whole.tempo == pytest.approx(1, abs=0.02)
    assert (np.diff(found.time_b_s) >= 0).all()


def test_size_heading_and_place_are_no_difference() -> None:
    times = np.arange(60) / 25
    first = performed(times)
    turn = [Rotation.from_euler("y", angle, degrees=True) for angle in np.linspace(20, 250, 60)]
    moved = np.stack([turn[t].apply(first.xyz[t]) for t in range(60)]) * 1.3
    second = dataclasses.replace(first, xyz=moved, unit="body heights")
    found = compare(first, second)
    assert found.unit == "metres"
    assert np.nanmax(found.distance) < 1e-6


def test_a_planted_difference_is_at_its_joint_and_of_its_size() -> None:
    times = np.arange(60) / 25
    first = performed(times)
    xyz = first.xyz.copy()
    xyz[:, SKELETON.index("left_wrist"), 1] += 0.1
    found = compare(first, dataclasses.replace(first, xyz=xyz))
    means = {d.joint: d.mean for d in found.phrases[0].joints}
    assert means["left_wrist"] == pytest.approx(0.1, abs=0.005)
    assert all(mean < 0.005 for joint, mean in means.items() if joint not in ("left_wrist", "all"))
    assert means["all"] == pytest.approx(0.1 / 16, abs=0.005)


def test_the_body_faces_forward_with_its_left_at_the_right_of_the_picture() -> None:
    xyz = make_poses(np.array([0.0, 0.5])).xyz
    turn = Rotation.from_euler("y", 77, degrees=True)
    moved = turn.apply(xyz.reshape(-1, 3)).reshape(xyz.shape) + 4
    turned = body_relative(moved, SKELETON)
    np.testing.assert_allclose(turned, body_relative(xyz, SKELETON), atol=1e-12)
    left, right = SKELETON.index("left_hip"), SKELETON.index("right_hip")
    assert (turned[:, left, 0] > turned[:, right, 0]).all()


def test_a_gap_has_no_difference() -> None:
    times = np.arange(80) / 25
    found = compare(with_gap(performed(times), slice(30, 40)), performed(times))
    missing = np.isnan(found.distance).all(axis=1)
    np.testing.assert_array_equal(missing, (np.arange(80) >= 30) & (np.arange(80) < 40))


def test_refuses_other_skeletons_and_too_little() -> None:
    times = np.arange(60) / 25
    other = make_poses(times, skeleton="paper15")
    with pytest.raises(UsageError, match="body17 and paper15"):
        compare(performed(times), other)
    with pytest.raises(DataError, match="second performance has 4 moments"):
        compare(performed(times), performed(times[:4]))


@pytest.fixture
def two_results(tmp_path: Path) -> tuple[Path, Path]:
    times = np.arange(60) / 25
    first = performed(times)
    xyz = first.xyz.copy()
    xyz[:, SKELETON.index("head"), 2] += 0.05
    write_poses(tmp_path / "teacher.npz", first)
    write_poses(tmp_path / "pupil.npz", dataclasses.replace(first, xyz=xyz))
    return tmp_path / "teacher.npz", tmp_path / "pupil.npz"


def test_the_command_writes_a_recording_and_a_table(
    two_results: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = two_results
    output = a.with_name("both.rrd")
    compare_command(a, b, output=output)
    said = capsys.readouterr().out
    assert "most at the head" in said and f"wrote {output}" in said
    recording = Recording(output)
    joints = [f"/world/{place}" for place in ("a", "b", "over/a", "over/b")]
    assert {*joints, "/world/over/difference", "/plots/difference"} <= recording.entities
    rows = recording.rows("/world/b", "Points3D:positions")
    assert len(rows) == 60 and rows[10][:2] == (10, pytest.approx(0.4))
    table = list(csv.DictReader((a.with_name("both.csv")).open()))
    assert table[0]["phrase"] == "whole" and table[0]["joint"] == "all"
    head = next(row for row in table if row["joint"] == "head")
    assert float(head["mean_difference_m"]) == pytest.approx(0.05, abs=0.005)
    text = recording.static("/table", "TextDocument:text")[0]
    assert "| head | 0.0" in text


def test_the_command_names_the_dancers_that_there_are(two_results: tuple[Path, Path]) -> None:
    a, b = two_results
    with pytest.raises(UsageError, match=r"pupil\.npz: has no dancer 4; it has: 1"):
        compare_command(a, b, output=a.with_name("both.rrd"), dancer_b=4)


def test_no_output_is_an_input(two_results: tuple[Path, Path]) -> None:
    a, b = two_results
    recording = a.with_suffix(".rrd")
    recording.write_bytes(b"RRF2 of dance2pose")
    with pytest.raises(UsageError, match="is an input"):
        compare_command(recording, b, output=recording, overwrite=True)


@pytest.mark.parametrize("which", ["first", "second"])
def test_a_performance_without_a_pose_is_named(which: str) -> None:
    whole = performed(np.arange(60) / 30)
    none = dataclasses.replace(whole, xyz=np.full_like(whole.xyz, np.nan))
    pair = (none, whole) if which == "first" else (whole, none)
    with pytest.raises(DataError, match=f"the {which} performance has no pose"):
        compare(*pair)


def test_one_phrase_is_one_phrase(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.npz"
    write_poses(path, performed(np.arange(40) / 30))
    compare_command(path, path, output=tmp_path / "out.rrd")
    assert capsys.readouterr().out.splitlines()[0].endswith("; 1 phrase")
