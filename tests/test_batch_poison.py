"""Videos that do the worst: each takes down at most its own worker, and the batch goes on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from archive_stub import batch, damage, videos
from dance2pose.archive.layout import Archive
from dance2pose.archive.packages import one_line, read_card
from dance2pose.errors import OutputError
from test_batch import errors, package_count, states


@pytest.fixture(autouse=True)
def stand_in_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))


def test_a_library_that_aborts_is_tried_so_often_and_told_with_its_last_words(
    tmp_path: Path,
) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "abort.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive, attempts=2)
    assert states(archive) == {"a.mp4": "done", "abort.mp4": "failed", "b.mp4": "done"}
    failure, error, attempts = errors(archive)["abort.mp4"]
    assert (failure, attempts) == ("crash", 2)
    assert "signal SIGABRT" in error
    assert "libfaulty: assertion failed" in error


def test_one_that_hangs_is_ended_at_the_time_limit(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "hang.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive, attempts=1, time_limit_min=0.05)
    assert errors(archive)["hang.mp4"][:2] == (
        "time",
        "took longer than the limit of 0.05 minutes",
    )
    assert states(archive)["b.mp4"] == "done"


def test_one_that_eats_memory_is_ended_at_the_memory_limit(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "hungry.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive, attempts=1, memory_limit_gb=0.5)
    assert errors(archive)["hungry.mp4"][:2] == (
        "memory",
        "took more memory than the limit of 0.5 GB",
    )
    assert states(archive)["b.mp4"] == "done"


def test_a_pipe_is_refused_without_being_opened(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4"), tmp_path / "archive"
    os.mkfifo(source / "endless.mp4")
    batch(source, archive)
    assert "is a pipe" in errors(archive)["endless.mp4"][1]


AWKWARD = [
    "two\nlines.mp4",
    "quote\"s and 'more'.mp4",
    "💃 emoji 🕺.mp4",
    "  leading and trailing  .mp4",
    "-rf.mp4",
    "%41 <b>&amp;.mp4",
    "a" * 246 + ".mp4",
    os.fsdecode(b"bytes that are no \xff\xfe UTF-8.mp4"),
]


def test_names_of_every_kind_go_through_to_package_ledger_and_report(tmp_path: Path) -> None:
    from dance2pose.commands.report import report

    source, archive = videos(tmp_path / "in", *AWKWARD), tmp_path / "archive"
    result = batch(source, archive)
    assert result.tally.done == len(AWKWARD)
    assert damage(archive) == []
    sources = {read_card(folder).source for _, _, folder in Archive(archive).found_packages()}
    assert sources == {source / name for name in AWKWARD}
    report(archive, quiet=True)
    page = (archive / "report.html").read_text(encoding="utf-8")
    assert "<b>&amp;" not in page
    for file in archive.glob("ledger.sqlite*"):
        file.unlink()
    assert batch(source, archive).plan.done == len(AWKWARD)


@given(st.text(max_size=40))
@settings(max_examples=60)
def test_text_for_one_line_holds_no_line_break_and_can_be_written(text: str) -> None:
    line = one_line(text)
    assert len(line.splitlines()) <= 1
    line.encode("utf-8")


def test_a_full_disk_as_a_worker_meets_it_stops_the_batch_and_the_item_waits(
    tmp_path: Path,
) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "full.mp4"), tmp_path / "archive"
    with pytest.raises(OutputError, match="the disk is full; make room"):
        batch(source, archive, workers=1)
    assert states(archive)["full.mp4"] == "waiting"
    assert damage(archive) == []
    assert not any((archive / "work").iterdir())


def test_a_disk_that_is_really_full_stops_the_batch_and_the_next_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1200k", "tmpfs", str(disk)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("needs the right to mount a small disk")
    try:
        source = videos(tmp_path / "in", *(f"{n:02d}.mp4" for n in range(40)))
        with pytest.raises(OutputError):
            batch(source, disk / "archive", workers=1)
        made = package_count(disk / "archive")
        assert 0 < made < 40
        assert damage(disk / "archive") == []
        subprocess.run(["mount", "-o", "remount,size=20m", str(disk)], check=True)
        batch(source, disk / "archive")
        assert set(states(disk / "archive").values()) == {"done"}
        assert package_count(disk / "archive") == 40
    finally:
        subprocess.run(["umount", str(disk)], check=True)
