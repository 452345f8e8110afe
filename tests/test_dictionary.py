"""Dictionaries: those that come with the project, learning, files and their faults."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dance2pose.body import body_bones_mm, bone_lengths, retarget
from dance2pose.errors import DataError, UsageError
from dance2pose.lifting.pursuit.dictionary import Dictionary, load, read, save
from dance2pose.mocap.corpus import Take
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get
from dictionary_training.learning import (
    LearningSettings,
    distinct,
    learn,
    training_poses,
)

SKELETONS = ("cmu17", "paper15", "body17")


def made_up_takes(skeleton: str, count: int = 3) -> list[Take]:
    known = get(skeleton)
    takes = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        ends = rng.normal(size=(2, len(known), 3))
        path = ends[0] + np.linspace(0, 1, 61)[:, None, None] * (ends[1] - ends[0])
        xyz = retarget(path, known, body_bones_mm(skeleton))
        takes.append(Take(f"made up {seed}", xyz, None, 60.0, skeleton))
    return takes


@pytest.mark.parametrize("skeleton", SKELETONS)
def test_dictionaries_that_come_with_the_project(skeleton: str) -> None:
    dictionary = load(skeleton)
    known = get(skeleton)
    assert dictionary.skeleton == skeleton
    assert dictionary.atoms.shape[1:] == (len(known), 3)
    assert len(dictionary) > 3 * len(known)  # over-complete
    np.testing.assert_allclose(np.linalg.norm(dictionary.atoms, axis=(1, 2)), 1, atol=1e-12)
    np.testing.assert_allclose(dictionary.atoms[:, 0], 0, atol=1e-6)
    np.testing.assert_allclose(dictionary.bone_lengths, body_bones_mm(skeleton), rtol=1e-6)
    # The mean pose is upright in body axes and symmetric, mirror images being in the corpus.
    np.testing.assert_allclose(
        dictionary.mean[list(known.mirror)] * [-1, 1, 1], dictionary.mean, atol=0.1
    )
    assert dictionary.mean[known.index("left_shoulder"), 0] > 100
    assert dictionary.mean[1, 1] > 100


@pytest.mark.parametrize("skeleton", SKELETONS)
def test_dictionaries_say_where_they_come_from(skeleton: str) -> None:
    metadata = load(skeleton).metadata
    assert "mocap.cs.cmu.edu" in metadata["licence"] and "EIA-0196217" in metadata["licence"]
    assert metadata["settings"]["seed"] == LearningSettings().seed
    assert metadata["settings"] == vars(LearningSettings())
    assert metadata["script"].startswith("train_dictionary.py")
    assert len(metadata["sources"]) > 100


@pytest.mark.shared
def test_no_dictionary_has_seen_the_evaluation_takes(shared: Path) -> None:
    evaluated = {path.stem for path in (shared / "mocap" / "eval").iterdir()}
    assert len(evaluated) == 11
    for skeleton in SKELETONS:
        assert not evaluated & set(load(skeleton).metadata["sources"])


def test_keypoint_and_unknown_skeletons_have_none() -> None:
    with pytest.raises(UsageError, match="body17"):
        load("coco17")
    with pytest.raises(UsageError, match="unknown skeleton"):
        load("octopus8")


@pytest.mark.parametrize("skeleton", SKELETONS)
def test_learning_is_repeatable_and_spans_the_poses(tmp_path: Path, skeleton: str) -> None:
    settings = LearningSettings(clusters=4, atoms_each=6, apart_mm=15.0)
    takes = made_up_takes(skeleton)
    poses = training_poses(takes, skeleton, settings)
    dictionary = learn(poses, skeleton, settings)
    again = learn(training_poses(takes, skeleton, settings), skeleton, settings)
    save(dictionary, tmp_path / "a.npz")
    save(again, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    # Unit norm, the first joint at rest, and the poses near the span of the atoms.
    np.testing.assert_allclose(np.linalg.norm(dictionary.atoms, axis=(1, 2)), 1)
    np.testing.assert_allclose(dictionary.atoms[:, 0], 0, atol=1e-9)
    flat = (poses - dictionary.mean).reshape(len(poses), -1)
    w = np.linalg.lstsq(dictionary.flat_atoms.T, flat.T, rcond=None)[0]
    left = np.sqrt(((flat.T - dictionary.flat_atoms.T @ w) ** 2).mean())
    assert left < 0.25 * np.sqrt((flat**2).mean())


def test_poses_made_of_atoms() -> None:
    settings = LearningSettings(clusters=4, atoms_each=6, apart_mm=15.0)
    dictionary = learn(training_poses(made_up_takes("cmu17"), "cmu17", settings), "cmu17", settings)
    active, w = np.array([[0, 5], [3, 1]]), np.array([[100.0, -20.0], [7.0, 0.0]])
    pose = dictionary.pose(active, w)
    for n in range(2):
        expected = dictionary.mean.copy()
        for atom, weight in zip(active[n], w[n], strict=True):
            expected = expected + weight * dictionary.atoms[atom]
        np.testing.assert_allclose(pose[n], expected)
    total = (np.linalg.norm(dictionary.bones_of(pose).reshape(2, 16, 3), axis=2) ** 2).sum(axis=1)
    np.testing.assert_allclose(total, (dictionary.bones_of(pose) ** 2).sum(axis=1))
    np.testing.assert_allclose(
        dictionary.sum_of_squared_lengths, (body_bones_mm("cmu17") ** 2).sum()
    )


def test_distinct_poses_are_apart_and_near_all_that_were_left_out() -> None:
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(60, 11, 3)) * np.array([30, 1, 1])
    kept = distinct(poses, 25.0)

    def apart(a: FloatArray, b: FloatArray) -> FloatArray:
        difference = (a[:, None] - b[None]).reshape(len(a), len(b), -1)
        rms: FloatArray = np.sqrt((difference**2).sum(axis=-1) / 11)
        return rms

    between = apart(kept, kept) + np.diag(np.full(len(kept), np.inf))
    assert 1 < len(kept) < 60
    assert between.min() > 25
    assert apart(poses, kept).min(axis=1).max() <= 25


def test_learning_from_nothing_is_refused() -> None:
    with pytest.raises(DataError, match="no take"):
        training_poses([], "cmu17", LearningSettings())


def small() -> Dictionary:
    rng = np.random.default_rng(1)
    atoms = rng.normal(size=(11, 15, 3))
    atoms[:, 0] = 0
    atoms /= np.linalg.norm(atoms, axis=(1, 2), keepdims=True)
    mean = 100 * rng.normal(size=(15, 3))
    return Dictionary("paper15", atoms, mean, rng.uniform(100, 200, 14), {"seed": 1})


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    dictionary = small()
    save(dictionary, tmp_path / "d.npz")
    back = read(tmp_path / "d.npz")
    assert back.skeleton == "paper15" and back.metadata == {"seed": 1}
    np.testing.assert_allclose(back.atoms, dictionary.atoms, atol=1e-6)
    np.testing.assert_allclose(back.mean, dictionary.mean, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"atoms": None}, "lacks 'atoms'"),
        ({"metadata": None}, "lacks 'metadata'"),
        ({"skeleton": np.array("octopus8")}, "unknown skeleton"),
        ({"skeleton": np.array("cmu17")}, r"atoms has shape \(11, 15, 3\)"),
        ({"mean": np.zeros((15, 2))}, r"mean has shape \(15, 2\)"),
        ({"mean": np.full((15, 3), np.nan)}, "expected finite"),
        ({"bone_lengths": np.zeros(3)}, "bone_lengths has shape"),
        ({"atoms": np.zeros((0, 15, 3))}, "no atoms"),
        ({"atoms": np.zeros((11, 15, 3))}, "atom without length"),
        ({"atoms": np.array(["a", "b"])}, "cannot be read"),
        ({"metadata": np.array("{")}, "cannot be read"),
        ({"mean": np.array([{}], dtype=object)}, "pickled"),
    ],
)
def test_broken_files_are_one_clear_error(
    tmp_path: Path, change: dict[str, FloatArray | None], message: str
) -> None:
    path = tmp_path / "broken.npz"
    dictionary = small()
    arrays = {
        "skeleton": np.array("paper15"),
        "atoms": dictionary.atoms,
        "mean": dictionary.mean,
        "bone_lengths": dictionary.bone_lengths,
        "metadata": np.array(json.dumps({})),
        **change,
    }
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(DataError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)


def test_a_truncated_file_and_one_that_is_not_there(tmp_path: Path) -> None:
    save(small(), tmp_path / "d.npz")
    whole = (tmp_path / "d.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    for name in ("half.npz", "gone.npz"):
        with pytest.raises(DataError, match=name):
            read(tmp_path / name)


@pytest.mark.shared
def test_the_script_writes_the_same_file_twice(shared: Path, tmp_path: Path) -> None:
    script = Path(__file__).resolve().parents[1] / "scripts" / "train_dictionary.py"
    source = shared / "mocap" / "train" / "02_01.bvh"
    options = ["--skeleton", "paper15", "--clusters", "5", "--atoms-each", "3"]
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        subprocess.run(
            [sys.executable, script, source, "-o", tmp_path / folder, *options],
            check=True,
            capture_output=True,
        )
    one, other = (tmp_path / folder / "dictionary_paper15.npz" for folder in ("a", "b"))
    assert one.read_bytes() == other.read_bytes()
    dictionary = read(one)
    assert dictionary.metadata["sources"] == ["02_01"]
    np.testing.assert_allclose(
        bone_lengths(dictionary.mean[None], get("paper15")),
        replace(dictionary).bone_lengths,
        rtol=0.5,
    )
