"""Bodies written by one run and read by the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dance2pose.body import Body, body_bones_mm
from dance2pose.body_file import body_for, read_bodies, write_bodies, write_body
from dance2pose.errors import DataError, OutputError


def a_body(skeleton: str, seed: int) -> Body:
    rng = np.random.default_rng(seed)
    usual = body_bones_mm(skeleton)
    lengths = usual * np.exp(rng.normal(0, 0.08, len(usual)))
    return Body(
        skeleton, lengths * usual.sum() / lengths.sum(), rng.uniform(0.01, 0.05, len(usual))
    )


def test_bodies_come_back_as_they_were(tmp_path: Path) -> None:
    bodies = {
        "1": a_body("body17", 1),
        'Anna B. "Bo"': a_body("cmu17", 2),
        "3": a_body("body17", 3),
    }
    write_bodies(tmp_path / "b.toml", bodies)
    found = read_bodies(tmp_path / "b.toml")
    assert list(found) == list(bodies)
    for name, body in bodies.items():
        assert found[name].skeleton == body.skeleton
        np.testing.assert_allclose(found[name].lengths_mm, body.lengths_mm, rtol=1e-3)
        np.testing.assert_allclose(found[name].spread, body.spread, atol=1e-5)


def test_one_dancer_is_anyones_body_and_several_are_told_by_number(tmp_path: Path) -> None:
    one, two = a_body("body17", 1), a_body("body17", 2)
    write_body(tmp_path / "one.toml", one)
    (found,) = read_bodies(tmp_path / "one.toml").values()
    np.testing.assert_allclose(found.lengths_mm, one.lengths_mm, rtol=1e-3)
    assert body_for({"1": one}, 7) is one
    assert body_for({"1": one, "2": two}, 2) is two
    assert body_for({"1": one, "2": two}, 7) is None


def test_an_earlier_file_is_not_overwritten_unless_that_is_asked_for(tmp_path: Path) -> None:
    write_body(tmp_path / "b.toml", a_body("body17", 1))
    before = (tmp_path / "b.toml").read_bytes()
    with pytest.raises(OutputError):
        write_body(tmp_path / "b.toml", a_body("body17", 2))
    assert (tmp_path / "b.toml").read_bytes() == before
    write_body(tmp_path / "b.toml", a_body("body17", 2), overwrite=True)
    assert (tmp_path / "b.toml").read_bytes() != before


def test_lengths_of_any_size_give_the_same_body(tmp_path: Path) -> None:
    path = tmp_path / "b.toml"
    write_body(path, a_body("body17", 1))
    (expected,) = read_bodies(path).values()
    text = path.read_text(encoding="utf-8")
    head, _, rest = text.partition("lengths = {")
    table, _, tail = rest.partition("}")
    pairs = [pair.split(" = ") for pair in table.split(",")]
    larger = ", ".join(f"{name} = {float(value) * 1.7}" for name, value in pairs)
    path.write_text(head + "lengths = {" + larger + "}" + tail, encoding="utf-8")
    (found,) = read_bodies(path).values()
    np.testing.assert_allclose(found.lengths_mm, expected.lengths_mm, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('unit = "body heights"', 'unit = "metres"', "unit is 'metres'"),
        ("[dancers.1]", "[people.1]", "names no dancer"),
        ('"body17"', '"coco17"', "skeleton is 'coco17'"),
        ("lengths = { neck", "lengths = { nose", "lengths must name these bones"),
        ("lengths = { neck = 0", "lengths = { neck = -0", "must be positive numbers"),
        ("lengths = { neck = 0", "lengths = { neck = 90", "bone to neck has a length that no body"),
        ("spread = { neck = 0", "spread = { neck = 3", "spread must lie between 0 and 1"),
        ("lengths = {", "lengths = [", "not TOML"),
    ],
)
def test_what_is_no_body_is_said_with_the_file(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    path = tmp_path / "b.toml"
    write_body(path, a_body("body17", 1))
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(DataError, match=said) as error:
        read_bodies(path)
    assert "b.toml" in str(error.value)


def test_a_file_that_is_missing_or_not_text_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        read_bodies(tmp_path / "none.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DataError, match="not TOML"):
        read_bodies(tmp_path / "b.toml")
