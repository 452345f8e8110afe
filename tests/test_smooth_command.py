"""`dance2pose smooth` on files of other programs: what it changes, keeps, and refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dance2pose.commands.smooth import smooth as run
from dance2pose.errors import DataError, OutputError, UsageError
from dance2pose.exchange import read_poses, write_poses
from dance2pose.npz_files import read_arrays
from dance2pose.smoothing import smooth, smooth_track
from recording_making import make_dancer

T, J = 9, 4
RNG = np.random.default_rng(0)
XYZ = RNG.normal(size=(T, J, 3))


# npz


def _npz(path: Path, **arrays: np.ndarray) -> Path:
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize(("key", "coordinates"), [("xyz", 3), ("xy", 2)])
def test_npz_coordinates_are_smoothed_and_all_else_kept(
    tmp_path: Path, key: str, coordinates: int
) -> None:
    values = XYZ[..., :coordinates].astype(np.float32)
    source = _npz(
        tmp_path / "in.npz",
        **{key: values},
        names=np.array(["a", "b"]),
        time_s=np.arange(T) / 25,
        confidence=RNG.uniform(size=(T, J)),
    )
    run(source, output=tmp_path / "out.npz", model="wma", window=3)
    before, after = read_arrays(source), read_arrays(tmp_path / "out.npz")
    assert list(after) == list(before)
    np.testing.assert_array_equal(after[key], smooth(values, model="wma", window=3))
    assert after[key].dtype == np.float32
    for name in set(before) - {key}:
        np.testing.assert_array_equal(after[name], before[name])


def test_npz_the_path_through_the_room_goes_with_the_poses(tmp_path: Path) -> None:
    root = RNG.normal(size=(T, 3))
    source = _npz(tmp_path / "in.npz", xyz=XYZ, root=root)
    run(source, output=tmp_path / "out.npz", model="ema", window=3)
    np.testing.assert_array_equal(
        read_arrays(tmp_path / "out.npz")["root"], smooth(root, model="ema", window=3)
    )


def test_npz_any_array_can_be_named(tmp_path: Path) -> None:
    angles = RNG.normal(size=(T, 2, 5, 3))
    source = _npz(tmp_path / "in.npz", xyz=XYZ, angles=angles)
    run(source, output=tmp_path / "out.npz", key="angles", model="sma", window=4)
    after = read_arrays(tmp_path / "out.npz")
    np.testing.assert_array_equal(after["angles"], smooth(angles, model="sma", window=4))
    np.testing.assert_array_equal(after["xyz"], XYZ)


def test_npz_one_euro_uses_the_times_in_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = np.cumsum(RNG.uniform(0.01, 0.1, T))
    source = _npz(tmp_path / "in.npz", xyz=XYZ, time_s=times)
    run(source, output=tmp_path / "out.npz", model="one-euro", window=3, cutoff=2.0)
    said = capsys.readouterr().err
    assert "cut-off 2 Hz" in said and "window" not in said
    expected = smooth(XYZ, model="one-euro", window=3, time_s=times, cutoff_hz=2.0)
    np.testing.assert_array_equal(read_arrays(tmp_path / "out.npz")["xyz"], expected)


@pytest.mark.parametrize(
    ("arrays", "options", "error", "complaint"),
    [
        ({"poses": XYZ}, {}, UsageError, r"neither xyz nor xy.*poses \(9, 4, 3\)"),
        ({"xyz": XYZ}, {"key": "abc"}, UsageError, "no array 'abc'"),
        ({"xyz": np.array(["a"] * T)}, {}, UsageError, "xyz: values of type"),
        ({"xyz": XYZ[:0]}, {}, UsageError, "no frame"),
        ({"xyz": XYZ[:1]}, {}, UsageError, "longer than the sequence of 1"),
        ({"xyz": XYZ}, {"window": 10}, UsageError, "window of 10 .* sequence of 9"),
        ({"xyz": XYZ}, {"window": 0}, UsageError, "window of 0"),
        ({"xyz": XYZ}, {"model": "kalman"}, UsageError, "unknown temporal model"),
        ({"xyz": np.full((T, J, 3), np.nan)}, {}, DataError, "xyz holds no value"),
        ({"xyz": XYZ, "time_s": np.arange(T - 1.0)}, {}, UsageError, r"time_s has shape \(8,\)"),
        ({"xyz": np.array([{}])}, {}, DataError, "pickled Python objects"),
    ],
)
def test_npz_faults_are_named_and_nothing_is_written(
    tmp_path: Path,
    arrays: dict[str, np.ndarray],
    options: dict[str, object],
    error: type[Exception],
    complaint: str,
) -> None:
    source = _npz(tmp_path / "in.npz", **arrays)
    with pytest.raises(error, match=complaint):
        run(source, output=tmp_path / "out.npz", **options)
    assert [path.name for path in tmp_path.iterdir()] == ["in.npz"]


# CSV


def test_csv_only_coordinates_change(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    rows = [f"{10 + t},{t / 25:.3f},walk,{t * t},{'' if t == 4 else -t},0.{t}" for t in range(T)]
    source.write_text("\n".join(["frame,time_s,label,hip_x,hip_y,hip_confidence", *rows]) + "\n")
    run(source, output=tmp_path / "out.csv", model="ema", window=3)
    before = [line.split(",") for line in source.read_text().splitlines()]
    after = [line.split(",") for line in (tmp_path / "out.csv").read_text().splitlines()]
    assert after[0] == before[0]
    for column in (0, 1, 2, 5):
        assert [row[column] for row in after] == [row[column] for row in before]
    x = np.arange(T) ** 2.0
    np.testing.assert_allclose(
        [float(row[3]) for row in after[1:]], smooth(x, model="ema", window=3), rtol=1e-8
    )
    y = np.where(np.arange(T) == 4, np.nan, -np.arange(T))
    smoothed = smooth(y, model="ema", window=3)
    for t in range(T):
        assert after[1 + t][4] == "" if t == 4 else float(after[1 + t][4]) == smoothed[t]


def test_csv_with_three_header_lines_semicolons_and_windows_line_ends(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    header = ["scorer;net;net;net", "bodyparts;nose;nose;nose", "coords;x;y;likelihood"]
    rows = [f"{t};{2.5 * t};{t * t};0.9" for t in range(T)]
    source.write_bytes("\r\n".join([*header, *rows, ""]).encode())
    run(source, output=tmp_path / "out.csv", model="sma", window=3)
    lines = (tmp_path / "out.csv").read_bytes().decode().split("\r\n")
    assert lines[:3] == header
    cells = [line.split(";") for line in lines[3:-1]]
    assert [row[0] for row in cells] == [str(t) for t in range(T)]
    assert {row[3] for row in cells} == {"0.9"}
    expected = smooth(2.5 * np.arange(T), model="sma", window=3)
    np.testing.assert_allclose([float(row[1]) for row in cells], expected)


def test_csv_a_column_that_counts_the_rows_is_kept(tmp_path: Path) -> None:
    source = tmp_path / "in.csv"
    source.write_text("sample,x\n" + "".join(f"{t + 3},{t}\n" for t in range(T)))
    run(source, output=tmp_path / "out.csv", model="mma", window=3)
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == [str(t + 3) for t in range(T)]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "the file is empty"),
        ("a,b\n", "no line holds numbers"),
        ("1,2\n3,4\n", "in.csv:1: expected a header line"),
        ("x,y\n1,2\n3\n", "in.csv:3: has 1 cells, expected 2"),
        ("x,y\n1,2\n3,four\n", "in.csv:3: 'four' in column 'y'"),
        ("x,y\n1,2\n3,inf\n", "in.csv:3: 'inf' in column 'y'"),
        ("frame,x\n0,1\n0,2\n1,3\n", "in.csv:3: frame is '0'.*one row a frame"),
        ("time,x\n0,1\n1,2\n0.5,3\n", "in.csv:4: time is '0.5'"),
        ("frame,time\n0,1\n1,2\n", "no column of numbers beside"),
        ('x,y\n1,"2\n3",4\n', "not a CSV file|quoted cell"),
    ],
)
def test_csv_faults_name_the_line(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "in.csv").write_text(text)
    with pytest.raises(DataError, match=complaint):
        run(tmp_path / "in.csv", output=tmp_path / "out.csv", window=1)
    assert not (tmp_path / "out.csv").exists()


def test_csv_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(DataError, match="not a text file"):
        run(tmp_path / "in.csv", output=tmp_path / "out.csv")


# TRC


def _trc(frames: int = T, *, said: int | None = None, blank: bool = True) -> str:
    lines = [
        "PathFileType\t4\t(X/Y/Z)\ttake.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames",
        f"25.0\t25.0\t{frames if said is None else said}\t2\tm\t25.0\t1\t{frames}",
        "Frame#\tTime\tRHip\t\t\tRKnee\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
        *([""] if blank else []),
    ]
    for t in range(frames):
        second = "\t\t" if t == 3 else f"{t * t}\t{-t}\t0.5"
        lines.append(f"{t + 1}\t{t / 25:.5f}\t{t}\t{2 * t}\t{t**3}\t{second}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("blank", [True, False])
def test_trc_header_times_and_gaps_are_kept(tmp_path: Path, blank: bool) -> None:
    source = tmp_path / "in.trc"
    source.write_text(_trc(blank=blank))
    run(source, output=tmp_path / "out.trc", model="wma", window=3)
    before = source.read_text().splitlines()
    after = (tmp_path / "out.trc").read_text().splitlines()
    start = 6 if blank else 5
    assert after[:start] == before[:start]
    assert len(after) == len(before)
    cells = [line.split("\t") for line in after[start:]]
    assert [row[:2] for row in cells] == [line.split("\t")[:2] for line in before[start:]]
    assert cells[3][5:] == ["", "", ""]
    cube = smooth(np.arange(T) ** 3.0, model="wma", window=3)
    np.testing.assert_allclose([float(row[4]) for row in cells], cube, rtol=1e-8)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hello\n", "in.trc:1: expected PathFileType"),
        (_trc().replace("NumFrames", "Frames"), "in.trc:3: expected NumFrames"),
        (_trc(said=T + 2), "holds 9 frames, its header says 11; is it truncated"),
        (_trc()[:-12], "in.trc:15: has . cells, expected 8"),
        (_trc().replace("Frame#\tTime", "Time\tFrame#"), "in.trc:4: expected the columns"),
        (_trc().replace("\tRKnee", "\t"), "in.trc:4: names 1 markers"),
        (_trc().replace("\t343\t", "\tabc\t"), "in.trc:14: 'abc' in column 'RHip Z'"),
        (_trc().replace("\n5\t", "\n2\t"), "in.trc:11: Frame# is '2'"),
    ],
)
def test_trc_faults_name_the_line(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "in.trc").write_text(text)
    with pytest.raises(DataError, match=complaint):
        run(tmp_path / "in.trc", output=tmp_path / "out.trc")
    assert not (tmp_path / "out.trc").exists()


# All kinds


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = _npz(tmp_path / "in.npz", xyz=XYZ, valid=np.ones((T, J - 1), bool))
    run(source, output=tmp_path / "out.npz", model="mma", window=4)
    said = capsys.readouterr()
    assert "smoothed xyz (kept as they are: valid): mma, window 4, late by 3 frames" in said.err
    assert said.out == f"wrote {tmp_path / 'out.npz'}\n"
    run(source, output=tmp_path / "out.npz", overwrite=True, quiet=True)
    assert capsys.readouterr() == ("", "")


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    source = _npz(tmp_path / "in.npz", xyz=XYZ)
    with pytest.raises(UsageError, match="same kind"):
        run(source, output=tmp_path / "out.csv")
    with pytest.raises(UsageError, match=r"expected a \.npz, \.csv, .*\.c3d, \.bvh file"):
        run(tmp_path / "in.fbx", output=tmp_path / "out.fbx")
    with pytest.raises(OutputError, match="exists already"):
        run(source, output=_npz(tmp_path / "there.npz", xyz=XYZ))
    with pytest.raises(DataError, match="cannot be read"):
        run(tmp_path / "absent.npz", output=tmp_path / "out.npz")
    with pytest.raises(UsageError, match="--key"):
        run(tmp_path / "in.csv", output=tmp_path / "out.csv", key="xyz")


@pytest.mark.parametrize(
    ("window", "status", "complaint"), [("3", 0, ""), ("99", 2, "longer than the sequence of 9")]
)
def test_from_the_shell(tmp_path: Path, window: str, status: int, complaint: str) -> None:
    _npz(tmp_path / "in.npz", xyz=XYZ)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "dance2pose", "smooth", "in.npz", "-o", "out.npz"),
            *("--model", "sma", "--window", window),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "out.npz").exists() == (status == 0)


def test_the_output_never_replaces_the_input(tmp_path: Path) -> None:
    source = _npz(tmp_path / "in.npz", xyz=XYZ)
    before = source.read_bytes()
    link = tmp_path / "link.npz"
    link.symlink_to(source)
    for output in (source, link):
        with pytest.raises(UsageError, match="is an input of this run"):
            run(source, output=output, overwrite=True)
    assert source.read_bytes() == before


def test_what_described_the_old_poses_is_computed_again_or_dropped(tmp_path: Path) -> None:
    dancer = make_dancer(1, frame=list(range(9)), time_s=[0.04 * n for n in range(9)])
    write_poses(tmp_path / "in.npz", dancer.raw)
    run(tmp_path / "in.npz", output=tmp_path / "out.npz", model="ema", window=3, quiet=True)
    smoothed = read_poses(tmp_path / "out.npz")
    expected = smooth_track(dancer.raw, model="ema", window=3)
    assert smoothed.sigma is None
    assert np.isnan(smoothed.reprojection_error).all()
    np.testing.assert_array_equal(smoothed.valid, expected.valid)
