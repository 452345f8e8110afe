"""Tables of several people, of European spreadsheets, and with holes, smoothed as what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.commands.smooth import smooth as run
from dance2pose.errors import DataError, UsageError
from dance2pose.smoothing import smooth
from dance2pose.tables import read_table

T = 11


def _smoothed(
    folder: Path, text: str, *, name: str = "in.csv", **options: object
) -> list[list[str]]:
    source = folder / name
    source.write_text(text)
    out = folder / f"out{source.suffix}"
    run(source, output=out, overwrite=True, quiet=True, **({"model": "ema", "window": 3} | options))
    separator = "\t" if "\t" in text else ";" if ";" in text else ","
    return [line.split(separator) for line in out.read_text().splitlines()]


def _ema(values: list[float] | np.ndarray) -> np.ndarray:
    return smooth(np.asarray(values, float), model="ema", window=3)


@pytest.mark.parametrize("order", ["frames first", "people first"])
@pytest.mark.parametrize("column", ["person", "track", "individuals", "id", "Dancer"])
def test_people_are_smoothed_each_by_themselves(tmp_path: Path, order: str, column: str) -> None:
    rows = [
        (t, who, (100 if who == "ann" else 0) + t * t) for t in range(T) for who in ("ann", "bo")
    ]
    if order == "people first":
        rows.sort(key=lambda row: row[1])
    text = f"frame,{column},hip_x\n" + "".join(f"{t},{who},{x}\n" for t, who, x in rows)
    after = _smoothed(tmp_path, text)[1:]
    assert [row[:2] for row in after] == [[str(t), who] for t, who, _ in rows]
    for who, start in (("ann", 100), ("bo", 0)):
        found = [float(row[2]) for row in after if row[1] == who]
        np.testing.assert_allclose(found, _ema(start + np.arange(T) ** 2), rtol=1e-8)


def test_a_long_table_is_smoothed_a_joint_at_a_time(tmp_path: Path) -> None:
    rows = [(t, j, n * 50 + t * t) for t in range(T) for n, j in enumerate(("hip", "knee"))]
    text = "frame,joint,x\n" + "".join(f"{t},{j},{x}\n" for t, j, x in rows)
    after = _smoothed(tmp_path, text)[1:]
    for n, joint in enumerate(("hip", "knee")):
        found = [float(row[2]) for row in after if row[1] == joint]
        np.testing.assert_allclose(found, _ema(n * 50 + np.arange(T) ** 2), rtol=1e-8)


def test_shots_are_not_smoothed_into_each_other(tmp_path: Path) -> None:
    text = "frame,shot,x\n" + "".join(f"{t},{t // 6},{100 * (t // 6)}\n" for t in range(12))
    assert {row[2] for row in _smoothed(tmp_path, text)[1:]} == {"0", "100"}


def test_people_shorter_than_the_window_are_borne_if_one_is_not(tmp_path: Path) -> None:
    text = "frame,person,x\n" + "".join(f"{t},a,{t}\n" for t in range(8)) + "0,b,5\n1,b,5\n"
    assert [row[2] for row in _smoothed(tmp_path, text, window=5)[-2:]] == ["5", "5"]
    with pytest.raises(UsageError, match=r"longer than the longest of its sequences of 8 frames"):
        _smoothed(tmp_path, text, window=9)


def test_two_rows_a_frame_with_nobody_named_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r":4: frame is '0', .* one row a frame and person"):
        _smoothed(tmp_path, "frame,x\n0,1\n1,2\n0,3\n1,4\n")
    with pytest.raises(DataError, match=r":5: frame is '1', expected more"):
        _smoothed(tmp_path, "frame,person,x\n0,a,1\n0,b,1\n1,a,2\n1,a,3\n1,b,2\n")


@pytest.mark.parametrize("clock", ["time", "frame", "coords", ""])
def test_absent_rows_are_holes_by_time_and_by_frame(tmp_path: Path, clock: str) -> None:
    there = [t for t in range(30) if t not in (11, 12, 13)]
    text = f"{clock},x\n" + "".join(f"{t},{0 if t < 12 else 100}\n" for t in there)
    assert [row[1] for row in _smoothed(tmp_path, text)[1:]] == ["0"] * 11 + ["100"] * 16


def test_semicolons_and_decimal_commas_are_read_and_kept(tmp_path: Path) -> None:
    text = "Bild;time;Hüfte_x;Hüfte_y\n"
    text += "".join(f"{t};{t / 25:.2f};{t * t / 4:.2f};{'' if t == 3 else t}\n" for t in range(T))
    text = text.replace(".", ",")
    after = _smoothed(tmp_path, text)
    assert after[0] == ["Bild", "time", "Hüfte_x", "Hüfte_y"]
    assert after[2][1] == "0,04"
    assert after[4][3] == ""
    found = [float(row[2].replace(",", ".")) for row in after[1:]]
    np.testing.assert_allclose(found, _ema(np.arange(T) ** 2 / 4), rtol=1e-8)
    assert not any("." in cell for row in after for cell in row)


def test_decimal_commas_and_points_in_one_table_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="decimal commas and decimal points"):
        _smoothed(tmp_path, "frame;x;y\n0;1,5;2.5\n1;1,5;2.5\n")


@pytest.mark.parametrize("kind", ["trc", "tsv"])
def test_a_last_row_may_end_in_empty_cells(tmp_path: Path, kind: str) -> None:
    rows = [f"{t + 1}\t{t / 25:.3f}\t{t}\t{t}\t{t}\t\t\t" for t in range(T)]
    head = ["frame\ttime\ta_x\ta_y\ta_z\tb_x\tb_y\tb_z"]
    rows[0] = "1\t0.000\t0\t0\t0\t5\t5\t5"
    if kind == "trc":
        head = [
            "PathFileType\t4\t(X/Y/Z)\tin.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
            f"25\t25\t{T}\t2\tm",
            "Frame#\tTime\tA\t\t\tB\t\t",
            "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
        ]
    after = _smoothed(tmp_path, "\n".join([*head, *rows]) + "\n", name=f"in.{kind}")
    assert after[-1][5:] == ["", "", ""]
    assert len(after) == len(head) + T
    np.testing.assert_allclose([float(r[2]) for r in after[len(head) :]], _ema(np.arange(T)))


def test_a_table_of_a_million_columns_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("x," * 1_000_000 + "\n" + "1," * 1_000_000 + "\n")
    with pytest.raises(DataError, match="has 1000001 columns, expected at most 20000"):
        read_table(tmp_path / "in.csv")


@settings(max_examples=30, deadline=None)
@given(
    people=st.lists(st.sampled_from("abc"), min_size=4, max_size=30),
    seed=st.integers(0, 99),
)
def test_random_people_in_random_order_are_never_mixed(
    tmp_path_factory: pytest.TempPathFactory, people: list[str], seed: int
) -> None:
    values = np.random.default_rng(seed).normal(size=len(people))
    counts = {who: 0 for who in people}
    lines = ["frame,person,x"]
    for who, value in zip(people, values, strict=True):
        lines.append(f"{counts[who]},{who},{value:.6f}")
        counts[who] += 1
    folder = tmp_path_factory.mktemp("people")
    after = _smoothed(folder, "\n".join(lines) + "\n", window=1 + (max(counts.values()) > 1))
    expected = np.array(values)
    for who, count in counts.items():
        rows = [n for n, other in enumerate(people) if other == who]
        if count > 1:
            part = np.round(values[rows], 6)
            expected[rows] = smooth(part, model="ema", window=2)
    np.testing.assert_allclose([float(row[2]) for row in after[1:]], expected, atol=2e-6)
