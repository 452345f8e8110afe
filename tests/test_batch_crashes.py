"""Processes of a batch are killed at random moments; the ledger and the packages stay true.

The long form, with real videos and models, is scripts/crash_test_batch.py.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from archive_stub import videos
from crash_test_batch import check, kill_repeatedly

COUNT = 12


@pytest.mark.skipif(sys.platform == "win32", reason="kills with SIGKILL")
def test_twenty_kills_lose_nothing_and_nothing_is_done_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STUB_SECONDS", "0.2")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    source = videos(tmp_path / "source", *(f"{n}.mp4" for n in range(COUNT)))
    archive = tmp_path / "archive"
    stub = str(Path(__file__).with_name("archive_stub.py"))

    def command(number: int) -> list[str]:
        return [sys.executable, stub, str(source), str(archive), str(number)]

    crashes = kill_repeatedly(command, kills=20, seed=9, longest_s=2.5)
    assert crashes.unexpected == []
    assert crashes.kills.total() == 20
    assert len(crashes.kills) == 3  # of workers, of the batch, and of all at once
    assert check(archive, items=COUNT, rounds=crashes.rounds) == []
