"""A result file is complete or absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dance2pose.errors import OutputError
from dance2pose.output_files import check_output, written_whole


def test_the_file_appears_only_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "result.rrd"
    with written_whole(path) as temporary:
        temporary.write_text("all of it")
        assert not path.exists()
        assert temporary.suffix == ".rrd"  # some libraries go by the suffix
    assert path.read_text() == "all of it"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_nothing_is_left_after_an_error(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), written_whole(tmp_path / "result.rrd") as temporary:
        temporary.write_text("half of it")
        raise error
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept_unless_told_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "result.rrd"
    path.write_text("old")
    with pytest.raises(OutputError, match="exists already"), written_whole(path):
        pass
    assert path.read_text() == "old"
    with written_whole(path, overwrite=True) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new"


def test_an_existing_file_survives_a_failed_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "result.rrd"
    path.write_text("old")
    with pytest.raises(RuntimeError), written_whole(path, overwrite=True) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"


def test_a_missing_folder_and_a_folder_in_the_way_are_said(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        check_output(tmp_path / "no" / "result.rrd", overwrite=False)
    with pytest.raises(OutputError, match="is a folder"):
        check_output(tmp_path, overwrite=True)


def test_a_read_only_folder_is_said_before_any_work() -> None:
    # /proc refuses new files even to root, for whom permissions mean nothing.
    if not Path("/proc/self").is_dir():
        pytest.skip("needs /proc")
    with pytest.raises(OutputError, match="cannot be written"):
        check_output(Path("/proc/self/result.rrd"), overwrite=False)


def test_a_full_disk_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    path = tmp_path / "result.rrd"
    with pytest.raises(OutputError, match="disk is full"), written_whole(path) as temporary:
        temporary.touch()
        with Path("/dev/full").open("wb", buffering=0) as full:
            full.write(os.urandom(10))
    assert list(tmp_path.iterdir()) == []


def test_a_very_long_name_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("អប្សរា" * 11 + ".rrd")  # 198 + 4 bytes in UTF-8, near the limit of 255
    with written_whole(path) as temporary:
        temporary.write_text("x")
    assert path.read_text() == "x"
