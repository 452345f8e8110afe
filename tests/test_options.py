"""Options: each checks itself and its combinations, once, in words for Python and the terminal."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dance2pose.errors import UsageError
from dance2pose.options import (
    LiftOptions,
    OutputOptions,
    Settings,
    SmoothModel,
    SmoothOptions,
    VideoOptions,
    combined,
    flat,
)
from dance2pose.temporal_models import MODELS


@pytest.mark.parametrize(
    ("kind", "options", "said"),
    [
        (LiftOptions, {"lifter": "papr"}, "did you mean 'paper'"),
        (LiftOptions, {"camera": "fisheye"}, "camera 'fisheye': expected auto"),
        (LiftOptions, {"lifter": "paper", "camera": "perspective"}, "weak-perspective"),
        (LiftOptions, {"fov_deg": 50, "lifter": "paper"}, "only the perspective camera"),
        (LiftOptions, {"fov_deg": 50, "camera": "weak-perspective"}, "only the perspective"),
        (LiftOptions, {"fov_deg": 4.9}, "5 to 170"),
        (LiftOptions, {"height_m": 162}, "metres, 0.3 to 3"),
        (LiftOptions, {"height_m": float("nan")}, "height nan"),
        (LiftOptions, {"height_m": "1.6"}, "height 1.6: expected a number"),
        (SmoothOptions, {"model": "median"}, "model 'median': expected auto"),
        (SmoothOptions, {"window": 5.5}, "window 5.5: expected a whole number"),
        (SmoothOptions, {"window": 0}, "1 or more"),
        (SmoothOptions, {"window": True}, "whole number"),
        (SmoothOptions, {"model": "savitzky-golay", "window": 4}, "odd window"),
        (VideoOptions, {"every": 0}, "every 0"),
        (VideoOptions, {"start_s": -1}, "start -1"),
        (VideoOptions, {"start_s": 2, "end_s": 1}, "end 1: expected more seconds than start, 2"),
        (VideoOptions, {"deinterlace": "on"}, "deinterlace 'on'"),
        (OutputOptions, {"picture": "jpeg"}, "picture 'jpeg'"),
    ],
)
def test_what_is_not_possible_is_refused_when_made(
    kind: Any, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        kind(**options)
    if kind is not OutputOptions:
        with pytest.raises(UsageError, match=said):
            Settings.of(**options)


def test_an_unknown_option_gets_the_nearest_name() -> None:
    with pytest.raises(UsageError, match=r"'heigth_m'; did you mean 'height_m'"):
        Settings.of(heigth_m=1.6)


def test_single_options_find_their_group_and_text_becomes_a_path() -> None:
    made = Settings.of(pose="p.onnx", end_s=3, model="mma", height_m=1.62)
    assert made.pose == Path("p.onnx")
    assert made.video == VideoOptions(end_s=3)
    assert made.smooth.model == "mma"
    assert made.lift.height_m == 1.62


def test_names_win_over_an_object_and_leave_the_rest() -> None:
    given_settings = Settings.of(every=2, window=9)
    both = combined(Settings, given_settings, {"window": 3})
    assert (both.video.every, both.smooth.window) == (2, 3)


def test_no_option_has_one_name_in_two_groups() -> None:
    groups = (VideoOptions, LiftOptions, SmoothOptions, OutputOptions)
    names = [field.name for group in groups for field in fields(group)]
    assert len(set(names)) == len(names)
    assert set(flat(Settings())) | set(flat(OutputOptions())) >= set(names)


def test_every_temporal_model_can_be_chosen() -> None:
    assert set(get_args(SmoothModel)) == {"auto", *MODELS}


@given(st.lists(st.sampled_from(["bvh", ".csv", " BVH", "glb", ""])))
def test_export_forms_are_named_once_each_in_order(words: list[str]) -> None:
    forms = OutputOptions(export=",".join(words)).forms
    assert len(set(forms)) == len(forms)
    assert all(form == form.strip().lower() for form in forms)
    assert set(forms) == {word.strip().lower().lstrip(".") for word in words if word.strip()}
