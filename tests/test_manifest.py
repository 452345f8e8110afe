"""Manifests: what they state is what is used, and what they may not state is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import get_type_hints

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.errors import ModelError, OutputError
from dance2pose.onnx_models.manifest import (
    _CHOICES,
    _FORMS_OF_KEY,
    _KINDS_OF_KEY,
    _RANGES,
    Manifest,
    read_manifest,
    settings_of,
    write_manifest,
)
from dance2pose.onnx_models.recognition import FORMS

POSE = Manifest(
    kind="pose",
    form="heatmap",
    input_width=192,
    input_height=256,
    layout="NHWC",
    colour_order="BGR",
    mean=(1.5, 2, 3),
    std=(4, 5, 6.25),
    resize="crop",
    skeleton="halpe26",
    box_scale=1.5,
    max_batch=8,
    name='a "quoted" näme\\ 舞\n',
)


def test_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    write_manifest(path, POSE)
    assert Manifest(**read_manifest(path)) == POSE
    with pytest.raises(OutputError, match="exists"):
        write_manifest(path, POSE)


@settings(max_examples=50, deadline=None)
@given(name=st.text(st.characters(exclude_categories=["Cs"])), box_scale=st.floats(0.5, 4))
def test_any_text_and_number_survives(
    name: str, box_scale: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("manifest") / "m.toml"
    manifest = dataclasses.replace(POSE, name=name, box_scale=box_scale)
    write_manifest(path, manifest)
    assert read_manifest(path) == settings_of(manifest)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("input_widht = 192", "unknown manifest key 'input_widht'; known: kind, form, input_width"),
        ('layout = "HWC"', "layout: 'HWC', expected one of"),
        ("layout = 3", "layout: 3, expected one of"),
        ("mean = [1, 2]", "mean: [1, 2], expected three numbers"),
        ("mean = [1, 2, true]", "expected three numbers"),
        ("std = [1, 0, 1]", "std: holds a zero"),
        ("std = [1, nan, 1]", "holds a value that is not finite"),
        ("input_width = 192.5", "input_width: 192.5, expected an integer"),
        ("input_width = true", "expected an integer"),
        ("input_width = 1000000", "input_width: 1000000, expected 8 to 4096"),
        ("score_threshold = nan", "score_threshold: nan, expected 0 to 1"),
        ('score_threshold = "high"', "expected a number"),
        ('skeleton = "coco19"', "skeleton: unknown 'coco19'; known: "),
        ("name = 5", "name: 5, expected a string"),
        ('kind = "detector"\nskeleton = "coco17"', "skeleton has no meaning for a model of kind"),
        ('form = "simcc"\nrefinement = "dark"', "refinement has no meaning for the output form"),
        ('layout = "NCHW', "is not TOML"),
        ("\x00", "is not TOML"),
    ],
)
def test_what_is_wrong_is_said(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(ModelError) as refused:
        read_manifest(path)
    assert str(refused.value).startswith(str(path))
    assert said in str(refused.value)


def test_not_text_and_not_there(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ModelError, match="is not TOML"):
        read_manifest(tmp_path / "m.toml")
    with pytest.raises(ModelError, match="cannot be read"):
        read_manifest(tmp_path / "other.toml")


def test_a_manifest_made_in_code_is_checked_too() -> None:
    with pytest.raises(ValueError, match="skeleton: missing"):
        dataclasses.replace(POSE, skeleton=None)
    with pytest.raises(ValueError, match="box_scale: 9, expected"):
        dataclasses.replace(POSE, box_scale=9)


def test_the_tables_name_fields_and_forms_that_exist() -> None:
    fields = set(get_type_hints(Manifest))
    assert {*_CHOICES, *_RANGES, *_KINDS_OF_KEY, *_FORMS_OF_KEY} <= fields
    assert set().union(*_FORMS_OF_KEY.values()) <= set(FORMS)
    without_nms = {f.name for f in FORMS.values() if f.kind != "pose" and not f.has_nms}
    assert _FORMS_OF_KEY["nms_threshold"] == without_nms
