"""Outputs: names planned before work, inputs never replaced, all files written or none."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dance2pose.errors import OutputError, OutputExistsError, UsageError
from dance2pose.exchange import write_poses
from dance2pose.outputs import OutputPlan, plan_outputs, wrote
from recording_making import make_dancer

OURS = b"PK dance2pose poses 2"


def plan(main: Path, **changes: object) -> OutputPlan:
    usual = {"kinds": (".rrd",), "beside": (".npz", ".track.npz")}
    return plan_outputs(main, **(usual | changes))  # type: ignore[arg-type]


def write_all(planned: OutputPlan, persons: int, text: bytes = OURS) -> None:
    with planned.writing() as staged:
        staged.path(planned.main).write_bytes(text)
        for person in range(1, persons + 1):
            for suffix in planned.beside:
                name = planned.name(suffix, None if person == 1 else person)
                staged.path(name).write_bytes(text)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_files_share_the_stem_and_appear_together(tmp_path: Path) -> None:
    planned = plan(tmp_path / "a.b.rrd")
    with planned.writing() as staged:
        staged.path(planned.main).write_bytes(b"1")
        staged.path(planned.name(".npz", 2)).write_bytes(b"2")
        assert all(name.startswith(".") for name in names(tmp_path))
    assert names(tmp_path) == ["a.b.dancer_2.npz", "a.b.rrd"]


def test_an_error_leaves_nothing(tmp_path: Path) -> None:
    planned = plan(tmp_path / "a.rrd")
    with pytest.raises(ZeroDivisionError), planned.writing() as staged:
        staged.path(planned.main).write_bytes(b"1")
        raise ZeroDivisionError
    assert names(tmp_path) == []


@pytest.mark.parametrize("name", ["tape", "tape.npz", "tape.RRD.txt"])
def test_a_name_with_another_suffix_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"\.rrd"):
        plan(tmp_path / name)


def test_a_missing_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        plan(tmp_path / "missing" / "a.rrd")


def spelled(folder: Path, video: Path) -> list[Path]:
    """Other names of one file: relative, through a link to it, to its folder, a hard link."""
    link, hard = folder / "link.rrd", folder / "hard.rrd"
    link.symlink_to(video)
    os.link(video, hard)
    (folder / "way").symlink_to(folder, target_is_directory=True)
    return [
        video,
        link,
        hard,
        folder / "way" / video.name,
        folder / ".." / folder.name / video.name,
    ]


def test_no_spelling_of_an_input_is_an_output(tmp_path: Path) -> None:
    video = tmp_path / "copy.rrd"
    video.write_bytes(OURS)
    for output in spelled(tmp_path, video):
        with pytest.raises(UsageError, match="input of this run"):
            plan(output, inputs=[None, video], overwrite=True)
    assert video.read_bytes() == OURS


def test_a_file_beside_the_output_may_be_an_input_too(tmp_path: Path) -> None:
    (tmp_path / "t.npz").write_bytes(OURS)
    with pytest.raises(UsageError, match=r"t\.npz: is an input"):
        plan(tmp_path / "t.rrd", inputs=[tmp_path / "t.npz"], overwrite=True)


def test_existing_files_are_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "a.dancer_2.npz").write_bytes(OURS)
    with pytest.raises(OutputExistsError, match=r"a\.dancer_2\.npz.*--overwrite"):
        plan(tmp_path / "a.rrd")


def test_only_our_own_files_are_replaced(tmp_path: Path) -> None:
    for name in ("a.rrd", "a.npz", "a.dancer_3.track.npz"):
        for other in tmp_path.iterdir():
            other.unlink()
        (tmp_path / name).write_bytes(b"somebody's work")
        with pytest.raises(OutputExistsError, match="not written by dance2pose"):
            plan(tmp_path / "a.rrd", overwrite=True)
        assert (tmp_path / name).read_bytes() == b"somebody's work"


def test_poses_of_the_first_version_are_ours(tmp_path: Path) -> None:
    dancer = make_dancer(1, frame=[0, 1, 2, 3, 4], time_s=[0.0, 0.1, 0.2, 0.3, 0.4])
    new, old = tmp_path / "new.npz", tmp_path / "old.npz"
    write_poses(new, dancer.smoothed)
    with np.load(new) as arrays:
        first = {k: v for k, v in arrays.items() if k not in ("format", "provenance", "shot")}
    np.savez(old, **first)
    assert wrote(new)
    assert wrote(old)
    np.savez(tmp_path / "other.npz", frames=np.zeros(3))
    assert not wrote(tmp_path / "other.npz")


def test_a_form_without_a_mark_is_ours_beside_our_own_file(tmp_path: Path) -> None:
    bvh = tmp_path / "a.bvh"
    bvh.write_text("HIERARCHY")
    assert not wrote(bvh)
    (tmp_path / "a.npz").write_bytes(OURS)
    assert wrote(bvh)


def test_a_run_with_fewer_dancers_removes_the_files_of_the_others(tmp_path: Path) -> None:
    write_all(plan(tmp_path / "a.rrd"), persons=3)
    (tmp_path / "a.dancer_2.notes.txt").write_text("mine")
    again = plan(tmp_path / "a.rrd", overwrite=True)
    write_all(again, persons=1, text=b"dance2pose, again")
    assert names(tmp_path) == ["a.dancer_2.notes.txt", "a.npz", "a.rrd", "a.track.npz"]
    assert (tmp_path / "a.npz").read_bytes() == b"dance2pose, again"


def test_a_run_that_fails_keeps_the_files_of_the_earlier_one(tmp_path: Path) -> None:
    write_all(plan(tmp_path / "a.rrd"), persons=2)
    before = names(tmp_path)
    again = plan(tmp_path / "a.rrd", overwrite=True)
    with pytest.raises(OutputError), again.writing() as staged:
        staged.path(again.main).write_bytes(b"dance2pose, new")
        staged.path(again.name(".npz"))  # never written: the commit must fail
    assert names(tmp_path) == before
    assert (tmp_path / "a.rrd").read_bytes() == OURS


def test_a_commit_that_fails_half_way_is_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_all(plan(tmp_path / "a.rrd"), persons=2)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    again = plan(tmp_path / "a.rrd", overwrite=True)
    rename, given = Path.rename, []

    def failing(self: Path, target: Path) -> Path:
        if not Path(target).name.startswith("."):
            given.append(target)
            if len(given) == 2:
                raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OutputError, match="disk is full"):
        write_all(again, persons=2, text=b"dance2pose, new")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_file_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    planned = plan(tmp_path / "a.rrd")
    with pytest.raises(OutputExistsError, match="appeared"), planned.writing() as staged:
        staged.path(planned.main).write_bytes(b"1")
        planned.main.write_bytes(b"theirs")
    assert planned.main.read_bytes() == b"theirs"
    assert names(tmp_path) == ["a.rrd"]


@given(
    stem=st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1),
    person=st.integers(2, 10_000),
)
def test_every_stem_gives_names_of_its_own(stem: str, person: int) -> None:
    planned = OutputPlan(Path(f"x{stem}.rrd"), (".npz", ".track.npz"))
    given_names = [
        planned.main,
        *(planned.name(suffix, n) for suffix in planned.beside for n in (None, person)),
    ]
    assert len(set(given_names)) == len(given_names)
    assert all(name.name.startswith(f"x{stem}") for name in given_names)
