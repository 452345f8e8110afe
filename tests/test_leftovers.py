"""What killed runs left behind is removed by the next run there, and nothing else is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose import leftovers
from dance2pose.leftovers import OLD_S, aside_name, sweep, temporary_name
from dance2pose.output_files import written_whole

WRITER = """
import sys, time
from pathlib import Path
from dance2pose.output_files import written_whole
with written_whole(Path(sys.argv[1])) as temporary:
    temporary.write_text("half of it")
    print("ready", flush=True)
    time.sleep(60)
"""


def start_writer(path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    return process


def parts(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir() if ".part" in entry.name)


def test_the_file_of_a_killed_run_is_swept_and_that_of_a_live_one_is_not(tmp_path: Path) -> None:
    killed, live = start_writer(tmp_path / "killed.rrd"), start_writer(tmp_path / "live.rrd")
    try:
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert len(parts(tmp_path)) == 2
        with written_whole(tmp_path / "mine.rrd") as temporary:
            temporary.write_text("all of it")
        (left,) = parts(tmp_path)
        assert left.startswith(".live.rrd.")
    finally:
        live.kill()
        live.wait()
    assert [entry.name for entry in sweep(tmp_path)] == [left]
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine.rrd"]


def test_a_number_given_to_another_process_since(tmp_path: Path) -> None:
    mine = temporary_name(tmp_path / "a.npz")
    mine.touch()
    pid = os.getpid()
    owner = f".{pid}-{leftovers._started(pid) or 0}-"
    before = tmp_path / mine.name.replace(owner, f".{pid}-1-")
    before.touch()
    if leftovers._started(pid) is None:
        pytest.skip("the start of a process is not known here")
    assert sweep(tmp_path) == [before]
    assert mine.exists()


def test_files_of_another_machine_are_left_until_they_are_old(tmp_path: Path) -> None:
    name = temporary_name(tmp_path / "a.npz").name
    foreign = tmp_path / name.replace(leftovers._machine(), "0123abcd")
    foreign.touch()
    assert sweep(tmp_path) == []
    long_ago = time.time() - OLD_S - 60
    os.utime(foreign, (long_ago, long_ago))
    assert sweep(tmp_path) == [foreign]


def test_links_and_folders_of_such_a_name_are_left(tmp_path: Path) -> None:
    dead = dead_name(tmp_path, "a.npz")
    dead.mkdir()
    target = tmp_path / "precious.npz"
    target.write_text("x")
    link = dead_name(tmp_path, "b.npz")
    link.symlink_to(target)
    assert sweep(tmp_path) == []
    assert target.read_text() == "x"


def test_a_folder_that_is_not_there_is_no_error(tmp_path: Path) -> None:
    assert sweep(tmp_path / "no") == []


def dead_name(folder: Path, name: str) -> Path:
    """The temporary name that a process which is no more gave."""
    process = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                             capture_output=True, text=True, check=True)  # fmt: skip
    pid = os.getpid()
    made = temporary_name(folder / name).name
    return folder / made.replace(f".{pid}-", f".{process.stdout.strip()}-")


names = st.text(
    st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=40
).filter(lambda name: name not in (".", ".."))


@given(st.lists(names, max_size=8, unique=True), st.lists(names, max_size=4, unique=True))
@settings(max_examples=40, deadline=None)
def test_no_file_of_any_other_name_is_ever_swept(others: list[str], outputs: list[str]) -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        kept = [folder / other for other in others if len(other.encode()) < 200]
        kept += [temporary_name(folder / output) for output in outputs]
        kept += [aside_name(folder / output) for output in outputs]
        kept += [folder / ".old.rrd.1a2b3c4d.part.rrd", folder / "video.mp4.part"]
        for path in kept:
            path.touch()
        before = sorted(folder.iterdir())
        assert sweep(folder) == []
        assert sorted(folder.iterdir()) == before


@given(names)
@settings(max_examples=60, deadline=None)
def test_temporary_names_are_hidden_in_the_folder_keep_the_suffix_and_fit(name: str) -> None:
    path = Path("folder") / name
    made = temporary_name(path)
    assert made.parent == path.parent and made.name.startswith(".")
    assert made.suffix == path.suffix[:16] or not path.suffix
    assert len(made.name.encode()) <= 255
    assert leftovers._TEMPORARY.fullmatch(made.name)
