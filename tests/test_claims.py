"""What a report claims of its takes: overlaps with what was learned from are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dance2pose.evaluation.claims import learned_from, overlap_sentence
from dance2pose.mocap.corpus import read_takes


def test_a_take_that_was_learned_from_is_named_with_the_file() -> None:
    learned = {"limits.npz": frozenset({"05_01", "06_02"}), "lifter.onnx": frozenset({"05_01"})}
    assert "none of them" in overlap_sentence(["07_05"], learned)
    text = overlap_sentence(["05_01", "07_05"], learned)
    assert text.startswith("**1 of them was learned from")
    assert "limits.npz: 05_01" in text and "lifter.onnx: 05_01" in text


def test_a_file_that_says_nothing_is_not_vouched_for() -> None:
    text = overlap_sentence(["07_05"], {"limits.npz": frozenset({"05_01"}), "x": frozenset()})
    assert "x does not say" in text
    assert "limits.npz was learned from" in text


def test_what_is_shipped_says_what_it_was_learned_from() -> None:
    for file, takes in learned_from().items():
        if file.endswith(".npz"):
            assert len(takes) > 50, file
            assert "05_01" in takes, file


@pytest.mark.shared
def test_no_shipped_file_was_learned_from_the_evaluation_set(shared: Path) -> None:
    takes = [path.stem for path in (shared / "mocap" / "eval").glob("*.bvh")]
    assert len(takes) == 11
    for file, learned in learned_from().items():
        assert not set(takes) & learned, file


@pytest.mark.shared
def test_asf_amc_takes_are_read_as_a_folder(shared: Path) -> None:
    takes = list(read_takes(shared / "mocap" / "asfamc"))
    assert [take.name for take in takes] == ["02_01", "02_03", "03_01"]
    assert all(take.rate_hz == 120 and np.isfinite(take.xyz).all() for take in takes)


@pytest.mark.shared
def test_a_name_alone_changes_no_rate(shared: Path, tmp_path: Path) -> None:
    """Only the salsa of the database, on its own rig, is slower than its files say."""
    source = (shared / "mocap" / "train" / "02_03.bvh").read_bytes()
    for name in ("my_salsa_night", "60_salsa_01"):
        (tmp_path / f"{name}.bvh").write_bytes(source)
    assert [round(take.rate_hz) for take in read_takes(tmp_path)] == [120, 120]
    salsa = next(read_takes(shared / "mocap" / "train" / "60_salsa_01.bvh"))
    assert salsa.rate_hz == 60
