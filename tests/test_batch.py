"""`dance2pose batch` around the work itself, which a stand-in does (archive_stub)."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

import archive_stub
from archive_stub import batch, damage, videos
from dance2pose.archive.layout import Archive, locked
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.packages import read_card
from dance2pose.archive.planning import Plan
from dance2pose.archive.verifying import verify
from dance2pose.errors import DataError, OutputError, UsageError
from dance2pose.options import Settings
from dance2pose.progress import Silent


@pytest.fixture(autouse=True)
def stand_in_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))


def states(archive: Path) -> dict[str, str]:
    """State of every item by its first name."""
    with contextlib.closing(Ledger(archive / "ledger.sqlite", read_only=True)) as ledger:
        return {item.names[0]: item.state for item in ledger.items()}


def errors(archive: Path) -> dict[str, tuple[str, str, int]]:
    with contextlib.closing(Ledger(archive / "ledger.sqlite", read_only=True)) as ledger:
        return {i.names[0]: (i.failure, i.error, i.attempts) for i in ledger.items("failed")}


def package_count(archive: Path) -> int:
    return sum(1 for _ in Archive(archive).found_packages())


def test_each_video_becomes_one_whole_package_and_nothing_is_left(tmp_path: Path) -> None:
    source = videos(tmp_path / "in", "a.mp4", "b.mov", "notes.txt")
    (source / "sub").mkdir()
    videos(source / "sub", "c.MKV", ".hidden.mp4")
    result = batch(source, tmp_path / "archive")
    assert (result.plan.new, result.tally.done, result.failed_in_all) == (3, 3, 0)
    assert states(tmp_path / "archive") == dict.fromkeys(("a.mp4", "b.mov", "sub/c.MKV"), "done")
    assert damage(tmp_path / "archive") == []
    assert package_count(tmp_path / "archive") == 3
    assert list((tmp_path / "archive" / "work").iterdir()) == []


def test_the_same_again_does_nothing_and_a_new_video_alone(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive)
    videos(source, "c.mp4")
    result = batch(source, archive)
    assert (result.plan.done, result.plan.to_do, result.tally.done) == (2, 1, 1)


def test_equal_content_is_processed_once_and_both_names_are_kept(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    shutil.copy(source / "a.mp4", source / "z copy.mp4")
    result = batch(source, archive)
    assert (result.plan.names, result.tally.done) == (3, 2)
    _, _, folder = next(p for p in Archive(archive).found_packages() if p[0].startswith("a-"))
    assert read_card(folder).names == ("a.mp4", "z copy.mp4")


def test_changed_settings_make_a_new_version_and_keep_the_old(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive)
    result = batch(source, archive, Settings.of(window=7))
    assert (result.plan.changed, result.tally.done) == (2, 2)
    assert sorted(version for _, version, _ in Archive(archive).found_packages()) == [1, 1, 2, 2]
    assert damage(archive) == []


def test_a_video_that_changes_becomes_a_new_version_of_its_item(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive)
    (source / "a.mp4").write_bytes(b"cut again")
    result = batch(source, archive)
    assert (result.plan.changed, result.plan.done, result.tally.done) == (1, 1, 1)
    assert sorted(version for _, version, _ in Archive(archive).found_packages()) == [1, 1, 2]


def test_a_renamed_video_is_not_done_again(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive)
    (source / "a.mp4").rename(source / "new name.mp4")
    assert batch(source, archive).plan == Plan(names=2, done=2)


def test_a_new_video_under_the_old_name_of_another_is_a_new_item(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4"), tmp_path / "archive"
    batch(source, archive)
    (source / "a.mp4").rename(source / "z.mp4")
    videos(source).joinpath("a.mp4").write_bytes(b"another film")
    result = batch(source, archive)
    assert (result.plan.done, result.plan.new, result.plan.changed) == (1, 1, 0)


def test_a_table_gives_settings_and_metadata_and_keeps_unknown_columns(tmp_path: Path) -> None:
    videos(tmp_path / "in", "a.mp4", "b.mp4")
    rows = [
        ["filename", "dc.title", "dc.creator", "shelf mark", "height", "person"],
        ["a.mp4", "Ein Tanz, «leise»", "Ünlü", "X 17", "1.62", "largest"],
        ["b.mp4", "", "", "", "", ""],
    ]
    with (tmp_path / "in" / "table.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    archive = tmp_path / "archive"
    batch(tmp_path / "in" / "table.csv", archive)
    by_name = {read_card(p).names[0]: read_card(p) for _, _, p in Archive(archive).found_packages()}
    assert by_name["a.mp4"].overrides == {"height": "1.62", "person": "largest"}
    assert by_name["a.mp4"].metadata[0]["shelf mark"] == "X 17"
    assert by_name["b.mp4"].overrides == {}
    info = next(Archive(archive).packages.glob("a-*/v1/bag-info.txt")).read_text(encoding="utf-8")
    assert "External-Description: Ein Tanz, «leise»" in info
    changed = (tmp_path / "in" / "table.csv").read_text(encoding="utf-8").replace("1.62", "1.70")
    (tmp_path / "in" / "table.csv").write_text(changed, encoding="utf-8")
    assert batch(tmp_path / "in" / "table.csv", archive).tally.done == 1


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("name,dc.title\na.mp4,x\n", "has no column 'filename'"),
        ("filename,height\na.mp4,tall\n", "height is 'tall'"),
        ("filename,height\na.mp4,99\n", "height 99"),
        ("filename,dc.title\na.mp4\n", ":2: has 1 cells, expected 2"),
        ("filename,filename\na.mp4,b.mp4\n", "names a column twice"),
        ("", "the table is empty"),
    ],
)
def test_a_wrong_table_is_refused_before_an_archive_is_made(
    tmp_path: Path, table: str, said: str
) -> None:
    videos(tmp_path, "a.mp4")
    (tmp_path / "table.csv").write_text(table)
    with pytest.raises((UsageError, DataError), match=said.replace("(", r"\(")):
        batch(tmp_path / "table.csv", tmp_path / "archive")
    assert not (tmp_path / "archive").exists()


def test_a_list_file_names_videos_beside_itself(tmp_path: Path) -> None:
    videos(tmp_path / "in", "a.mp4", "b.mp4")
    (tmp_path / "list.txt").write_text("# the first tape\nin/a.mp4\n\nin/absent.mp4\n")
    result = batch(tmp_path / "list.txt", tmp_path / "archive")
    assert (result.tally.done, result.failed_in_all) == (1, 1)
    assert "No such file" in errors(tmp_path / "archive")["in/absent.mp4"][1]


def test_a_lost_ledger_is_made_again_from_the_packages(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    shutil.copy(source / "a.mp4", source / "twin.mp4")
    batch(source, archive)
    batch(source, archive, Settings.of(window=7))
    for file in archive.glob("ledger.sqlite*"):
        file.unlink()
    assert batch(source, archive, Settings.of(window=7)).plan == Plan(names=3, done=2)
    assert package_count(archive) == 4
    with contextlib.closing(sqlite3.connect(archive / "ledger.sqlite")) as ledger:
        assert ledger.execute("SELECT count(*) FROM packages").fetchone() == (4,)


def test_a_damaged_ledger_is_put_aside_and_made_again(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4"), tmp_path / "archive"
    batch(source, archive)
    for file in archive.glob("ledger.sqlite-*"):
        file.unlink()
    (archive / "ledger.sqlite").write_bytes(b"this is not a ledger" * 300)
    assert batch(source, archive).plan == Plan(names=2, done=2)
    assert len(list(archive.glob("ledger.damaged-*.sqlite"))) == 1


def test_a_second_batch_on_the_same_archive_is_refused(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4"), tmp_path / "archive"
    batch(source, archive)
    with (
        locked(Archive(archive)),
        pytest.raises(OutputError, match=f"is being written by process {os.getpid()}"),
    ):
        batch(source, archive)


def test_a_folder_that_is_no_archive_is_not_written_to(tmp_path: Path) -> None:
    source = videos(tmp_path / "in", "a.mp4")
    with pytest.raises(UsageError, match="exists and is not an archive"):
        batch(source, source)
    assert [path.name for path in source.iterdir()] == ["a.mp4"]


def test_an_archive_inside_its_source_is_not_taken_for_a_part_of_it(tmp_path: Path) -> None:
    source = videos(tmp_path / "in", "a.mp4")
    batch(source, source / "archive")
    videos(source / "archive" / "packages", "not a source.mp4")
    assert batch(source, source / "archive").plan.names == 1


def test_a_failure_by_the_video_is_not_tried_again_until_asked(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "broken.mp4", "a.mp4"), tmp_path / "archive"
    batch(source, archive)
    assert errors(archive)["broken.mp4"] == ("input", "broken.mp4: is not a video", 1)
    assert batch(source, archive).plan == Plan(names=2, done=1, failed=1)
    with contextlib.closing(Ledger(archive / "ledger.sqlite")) as ledger:
        assert ledger.put_back_failed() == 1
    assert batch(source, archive).plan == Plan(names=2, done=1, waiting=1)


def test_verify_names_what_is_damaged_missing_and_extra(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4", "c.mp4"), tmp_path / "archive"
    batch(source, archive)
    assert verify(Archive(archive), Silent()).problems == ()
    one, two, three = (folder for _, _, folder in Archive(archive).found_packages())
    (one / "data" / "poses.csv").write_text("frame\nforged\n")
    (one / "data" / "quality.json").unlink()
    (two / "data" / "extra.txt").write_text("extra")
    shutil.rmtree(three)
    found = verify(Archive(archive), Silent())
    said = "\n".join(f"{package}: {problem}" for package, problem in found.problems)
    assert len(found.problems) == 4
    assert f"{one.parent.name}/v1: damaged: data/poses.csv: sha256 " in said
    assert f"{one.parent.name}/v1: missing: data/quality.json" in said
    assert f"{two.parent.name}/v1: extra: data/extra.txt" in said
    assert f"{three.parent.name}/v1: missing: the ledger has it" in said


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_batch_leaves_nothing_half_and_the_next_goes_on(
    tmp_path: Path, sent: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STUB_SECONDS", "1.5")
    source, archive = videos(tmp_path / "in", *(f"{n}.mp4" for n in range(6))), tmp_path / "archive"
    code = (
        "import sys, signal\nfrom pathlib import Path\nimport archive_stub\n"
        "from dance2pose.cli import _stop\nsignal.signal(signal.SIGTERM, _stop)\n"
        "try: archive_stub.batch(Path(sys.argv[1]), Path(sys.argv[2]))\n"
        "except KeyboardInterrupt: sys.exit(130)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(source), str(archive)])
    wait_for(lambda: any((archive / "work").glob("*")))
    process.send_signal(sent)
    assert process.wait(timeout=30) == 130
    assert set(states(archive).values()) <= {"waiting", "done"}
    assert damage(archive) == []
    monkeypatch.setenv("STUB_SECONDS", "0")
    batch(source, archive)
    assert set(states(archive).values()) == {"done"}
    assert package_count(archive) == 6


def wait_for(condition: object, seconds: float = 30) -> None:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.05)


def test_workers_end_when_their_batch_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import psutil

    monkeypatch.setenv("STUB_SECONDS", "600")
    source, archive = videos(tmp_path / "in", "a.mp4"), tmp_path / "archive"
    stub = archive_stub.__file__
    process = subprocess.Popen([sys.executable, stub, str(source), str(archive), "3"])
    wait_for(lambda: any((archive / "work").glob("*")))
    workers = psutil.Process(process.pid).children()
    process.kill()
    process.wait()
    assert workers
    assert psutil.wait_procs(workers, timeout=10)[1] == []


def test_the_ledger_counts_and_the_report_data_agree(tmp_path: Path) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "broken.mp4"), tmp_path / "archive"
    batch(source, archive)
    result = subprocess.run(
        [sys.executable, "-m", "dance2pose", "status", str(archive), "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(result.stdout)
    assert (found["items"], found["done"], found["failed"]) == (2, 1, 1)
    assert found["failures"][0]["reason"] == "input"
    assert found["verdicts"] == {"review": 1}
