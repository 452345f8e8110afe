"""Tracks and poses survive the way through a file, and what is not one is refused by name."""

from __future__ import annotations

import dataclasses
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dance2pose import skeleton
from dance2pose.errors import DataError, OutputError
from dance2pose.exchange import read_poses, read_track, write_poses, write_track
from dance2pose.npz_files import read_arrays, write_arrays
from dance2pose.poses import Timeline, Track2D, Track3D

T = 7


def _track() -> Track2D:
    rng = np.random.default_rng(1)
    joints = len(skeleton.get("halpe26"))
    xy = rng.uniform(0, 500, (T, joints, 2)).astype(np.float32)
    confidence = rng.uniform(0, 1, (T, joints)).astype(np.float32)
    xy[2, 5] = np.nan
    confidence[2, 5] = 0
    return Track2D(
        person=3,
        timeline=Timeline(
            np.arange(4, 4 + T, dtype=np.int64) * 2, np.array([0.1, 0.15, 0.3, 0.31, 0.5, 0.6, 0.7])
        ),
        xy=xy,
        confidence=confidence,
        skeleton="halpe26",
        interpolated=np.arange(T) == 3,
        box=rng.uniform(0, 500, (T, 4)).astype(np.float32),
        image_size=(640, 360),
        shot=2,
    )


def _poses(*, bare: bool) -> Track3D:
    rng = np.random.default_rng(2)
    joints = len(skeleton.get("paper15"))
    return Track3D(
        person=2,
        timeline=Timeline(np.arange(T, dtype=np.int64), np.linspace(0, 1, T)),
        xyz=rng.normal(size=(T, joints, 3)),
        unit="metres",
        skeleton="paper15",
        reprojection_error=rng.uniform(size=(T, joints)),
        valid=rng.uniform(size=(T, joints - 1)) > 0.5,
        estimated=rng.uniform(size=(T, joints)) > 0.5,
        sigma=None if bare else rng.uniform(size=(T, joints)),
        root=None if bare else rng.normal(size=(T, 3)),
    )


def _assert_same(left: Any, right: Any) -> None:
    for field in dataclasses.fields(left):
        a, b = getattr(left, field.name), getattr(right, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, field.name
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        else:
            assert a == b, field.name


def test_track_comes_back_as_it_was(tmp_path: Path) -> None:
    write_track(tmp_path / "track.npz", _track())
    _assert_same(read_track(tmp_path / "track.npz"), _track())


@pytest.mark.parametrize("bare", [False, True])
def test_poses_come_back_as_they_were(tmp_path: Path, bare: bool) -> None:
    write_poses(tmp_path / "poses.npz", _poses(bare=bare))
    _assert_same(read_poses(tmp_path / "poses.npz"), _poses(bare=bare))


def test_numpy_reads_what_is_written(tmp_path: Path) -> None:
    write_track(tmp_path / "track.npz", _track())
    with np.load(tmp_path / "track.npz", allow_pickle=False) as arrays:
        assert arrays["xy"].dtype == np.float32
        assert arrays["time_s"].dtype == np.float64
        assert arrays["frame"].dtype == np.int64
        assert str(arrays["skeleton"]) == "halpe26"
        assert tuple(arrays["joints"]) == skeleton.get("halpe26").joints
        np.testing.assert_array_equal(arrays["image_size"], (640, 360))


def test_the_same_arrays_give_the_same_bytes(tmp_path: Path) -> None:
    write_track(tmp_path / "a.npz", _track())
    write_track(tmp_path / "b.npz", _track())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_only_the_documented_keys_are_needed(tmp_path: Path) -> None:
    write_track(tmp_path / "full.npz", _track())
    arrays = read_arrays(tmp_path / "full.npz")
    for key in ("person", "shot", "interpolated", "box"):
        del arrays[key]
    np.savez(tmp_path / "track.npz", **arrays)  # as another program would write it
    track = read_track(tmp_path / "track.npz")
    assert (track.person, track.shot) == (1, 0)
    assert not track.interpolated.any()
    assert np.isnan(track.box).all()


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("xy", np.zeros((T, 26, 3)), "xy has shape"),
        ("xy", np.zeros((T, 25, 2)), "confidence has shape"),
        ("xy", np.zeros((0, 26, 2)), "no frame"),
        ("xy", np.full((T, 26, 2), np.inf), "infinite"),
        ("xy", np.full((T, 26, 2), "a"), "expected numbers"),
        ("confidence", np.zeros((T, 17)), "confidence has shape"),
        ("time_s", np.arange(T + 1.0), "time_s has shape"),
        ("time_s", np.array([0, 1, 2, 3, 2.5, 5, 6]), "row 4"),
        ("time_s", np.array([0, 1, np.nan, 3, 4, 5, 6]), "row 2"),
        ("frame", np.array([0, 1, 2, 2, 4, 5, 6]), "row 3"),
        ("frame", np.arange(T) * 0.5, "expected integers"),
        ("joints", np.array(skeleton.get("halpe26").joints[::-1]), "joints are"),
        ("joints", np.arange(26), "expected text"),
        ("skeleton", np.array("octopus"), "unknown skeleton"),
        ("skeleton", np.array("coco17"), "the skeleton coco17 has"),
        ("image_size", np.array([640]), "image_size has shape"),
        ("image_size", np.array([640, -1]), "image_size is"),
        ("interpolated", np.zeros(T), "expected flags"),
        ("box", np.zeros((T, 5)), "box has shape"),
    ],
)
def test_a_wrong_array_is_refused_by_name(
    tmp_path: Path, key: str, value: np.ndarray, complaint: str
) -> None:
    path = tmp_path / "track.npz"
    write_track(tmp_path / "right.npz", _track())
    write_arrays(path, read_arrays(tmp_path / "right.npz") | {key: value})
    with pytest.raises(DataError, match=complaint) as caught:
        read_track(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("key", ["xy", "confidence", "time_s", "frame", "joints", "skeleton"])
def test_a_missing_array_is_named(tmp_path: Path, key: str) -> None:
    write_track(tmp_path / "right.npz", _track())
    arrays = read_arrays(tmp_path / "right.npz")
    del arrays[key]
    write_arrays(tmp_path / "track.npz", arrays)
    with pytest.raises(DataError, match=f"no array '{key}'"):
        read_track(tmp_path / "track.npz")


def test_a_wrong_unit_is_refused(tmp_path: Path) -> None:
    write_poses(tmp_path / "right.npz", _poses(bare=True))
    arrays = read_arrays(tmp_path / "right.npz") | {"unit": np.array("feet")}
    write_arrays(tmp_path / "poses.npz", arrays)
    with pytest.raises(DataError, match="'feet', expected 'body heights' or 'metres'"):
        read_poses(tmp_path / "poses.npz")


def test_2d_for_3d_and_the_reverse_are_told_apart(tmp_path: Path) -> None:
    write_track(tmp_path / "track.npz", _track())
    write_poses(tmp_path / "poses.npz", _poses(bare=True))
    with pytest.raises(DataError, match="lift it first"):
        read_poses(tmp_path / "track.npz")
    with pytest.raises(DataError, match="holds 3D poses"):
        read_track(tmp_path / "poses.npz")


def test_pickles_are_never_read(tmp_path: Path) -> None:
    path = tmp_path / "track.npz"

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (tmp_path / "sprung",))

    np.savez(path, xy=np.array([Trap()], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match="'xy' holds pickled Python objects"):
        read_track(path)
    assert not (tmp_path / "sprung").exists()


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "track.npz"
    write_track(path, _track())
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataError, match=r"not a whole \.npz file"):
        read_track(path)


def test_damaged_bytes_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "track.npz"
    write_track(path, _track())
    damaged = bytearray(path.read_bytes())
    damaged[200:220] = bytes(20)
    path.write_bytes(bytes(damaged))
    with pytest.raises(DataError):
        read_track(path)


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04"])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "track.npz"
    path.write_bytes(content)
    with pytest.raises(DataError, match="track"):
        read_track(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.npz", tmp_path):
        with pytest.raises(DataError, match="cannot be read"):
            read_track(path)


def _header(shape: str) -> bytes:
    text = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"
    text = text.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize("shape", ["(1000000000, 26, 2)", "(99999999999999999999, 2)", "(-1, 2)"])
def test_a_header_that_claims_too_much_is_refused_before_memory_is_taken(
    tmp_path: Path, shape: str
) -> None:
    path = tmp_path / "track.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xy.npy", _header(shape) + bytes(64))
    with pytest.raises(DataError, match="xy"):
        read_track(path)


def test_a_bomb_is_refused_by_its_unpacked_size(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, xy=np.zeros((500, 26, 2)))
    assert path.stat().st_size < 20_000
    with pytest.raises(DataError, match="unpacked"):
        read_arrays(path, max_bytes=100_000)


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "track.npz"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists"):
        write_track(path, _track())
    assert path.read_text() == "mine"
    write_track(path, _track(), overwrite=True)
    assert len(read_track(path)) == T
    assert [p.name for p in tmp_path.iterdir()] == ["track.npz"]


def test_a_failed_write_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="pickle"):
        write_arrays(tmp_path / "x.npz", {"bad": np.array([object()])})
    assert list(tmp_path.iterdir()) == []
