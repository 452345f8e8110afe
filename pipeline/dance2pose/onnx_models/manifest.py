"""The manifest of an ONNX model: what its graph cannot say, as TOML beside the model.

`yolox.onnx` has its manifest in `yolox.toml`. A manifest states as much as it likes; the rest is
recognised from the graph (`recognition`). `dance2pose models inspect` writes a complete one to
start from.
"""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from dance2pose import skeleton as skeletons
from dance2pose.errors import ModelError
from dance2pose.output_files import written_whole

Kind = Literal["detector", "pose", "one-stage"]
Layout = Literal["NCHW", "NHWC"]
ColourOrder = Literal["RGB", "BGR"]
Resize = Literal["letterbox", "stretch", "crop"]
PaddingPosition = Literal["top-left", "centre"]
BoxFormat = Literal["xyxy", "cxcywh", "xywh", "yxyx"]
BoxUnit = Literal["pixels", "fractions"]
ScoreActivation = Literal["none", "sigmoid", "softmax"]
Refinement = Literal["none", "quarter", "dark"]
HeatmapAlignment = Literal["stride", "corners"]
Triple = tuple[float, float, float]

MAX_INPUT_SIDE = 4096


@dataclass(frozen=True)
class Manifest:
    """How pictures go into a model and how its outputs are read.

    kind: detector (picture -> boxes), pose (crop -> keypoints) or one-stage (picture -> both).
    form: the output form, a name of `dance2pose.onnx_models.recognition.FORMS`.
    input_width, input_height: px of the network's picture.
    layout, colour_order: of the input tensor.
    mean, std: per channel in the tensor's colour order, in 0..255 units; (value - mean) / std.
    resize: letterbox keeps the aspect and pads; stretch does not; crop cuts out a person's box.
    padding_position, padding_value: where a letterboxed picture lies, and the grey around it.
    max_batch: most pictures a call, None for as many as the graph takes.
    person_class: index of the class that is a person, among the model's classes.
    score_threshold: boxes below it are dropped. nms_threshold: intersection over union above
    which the weaker of two boxes is dropped, where the graph has no NMS inside.
    box_format, box_unit: of forms that leave it open (boxes-scores-classes).
    score_activation: what makes scores of a head's values: none (they are), sigmoid or softmax.
    skeleton: what the keypoints are, a name of `dance2pose.skeleton`.
    box_scale: a person's box is widened by this factor before the crop.
    refinement: of a heatmap's maximum: none, quarter (a quarter of a heatmap pixel towards the
    larger neighbour) or dark (Zhang et al., Distribution-Aware Coordinate Representation for
    Human Pose Estimation, CVPR 2020).
    heatmap_alignment: stride, heatmap pixel i is input pixel i * stride; corners, the first and
    last pixels coincide (models trained with unbiased data processing, such as ViTPose).
    model: file name of the ONNX model beside the manifest, where it is not the manifest's own.
    name, source, license: for the reader and the provenance.
    """

    kind: Kind
    form: str
    input_width: int
    input_height: int
    layout: Layout = "NCHW"
    colour_order: ColourOrder = "RGB"
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)
    resize: Resize = "letterbox"
    padding_position: PaddingPosition = "top-left"
    padding_value: int = 114
    max_batch: int | None = None
    person_class: int = 0
    score_threshold: float = 0.4
    nms_threshold: float = 0.45
    box_format: BoxFormat = "xyxy"
    box_unit: BoxUnit = "pixels"
    score_activation: ScoreActivation = "none"
    skeleton: str | None = None
    box_scale: float = 1.25
    refinement: Refinement = "dark"
    heatmap_alignment: HeatmapAlignment = "stride"
    model: str | None = None
    name: str | None = None
    source: str | None = None
    license: str | None = None

    def __post_init__(self) -> None:
        for key, problem in _problems(self):
            raise ValueError(f"{key}: {problem}")


_KINDS: tuple[str, ...] = get_args(Kind)
_FINDS_PEOPLE = frozenset({"detector", "one-stage"})
_FINDS_KEYPOINTS = frozenset({"pose", "one-stage"})

_CHOICES: dict[str, tuple[str, ...]] = {
    "kind": _KINDS,
    "layout": get_args(Layout),
    "colour_order": get_args(ColourOrder),
    "resize": get_args(Resize),
    "padding_position": get_args(PaddingPosition),
    "box_format": get_args(BoxFormat),
    "box_unit": get_args(BoxUnit),
    "score_activation": get_args(ScoreActivation),
    "refinement": get_args(Refinement),
    "heatmap_alignment": get_args(HeatmapAlignment),
}
_RANGES: dict[str, tuple[float, float]] = {
    "input_width": (8, MAX_INPUT_SIDE),
    "input_height": (8, MAX_INPUT_SIDE),
    "padding_value": (0, 255),
    "max_batch": (1, 256),
    "person_class": (0, 100_000),
    "score_threshold": (0, 1),
    "nms_threshold": (0, 1),
    "box_scale": (0.5, 4),
}
# Keys that only some kinds of model, or only some output forms, have; the others belong to all.
_KINDS_OF_KEY: dict[str, frozenset[str]] = {
    "person_class": frozenset({"detector"}),
    "score_threshold": _FINDS_PEOPLE,
    "padding_position": _FINDS_PEOPLE,
    "padding_value": _FINDS_PEOPLE,
    "skeleton": _FINDS_KEYPOINTS,
    "box_scale": frozenset({"pose"}),
    "max_batch": frozenset({"pose"}),
}
_BOXES_APART = frozenset({"boxes-scores", "boxes-scores-classes", "queries"})
_ROWS = frozenset(
    {
        "rows-xyxy-score-class",
        "rows-xyxy-class-score",
        "rows-class-score-xyxy",
        "cells-xyxy-score-class",
    }
)
_CELLS = frozenset({"yolox", "yolov5", "yolov8", "yolov8-pose", "cells-xyxy-score-class"})
_FORMS_OF_KEY: dict[str, frozenset[str]] = {
    "nms_threshold": _CELLS | {"boxes-scores"},
    "box_format": _BOXES_APART | _ROWS,
    "box_unit": _BOXES_APART | _ROWS | {"yolov5", "yolov8"},
    "score_activation": frozenset({"boxes-scores", "queries"}),
    "refinement": frozenset({"heatmap"}),
    "heatmap_alignment": frozenset({"heatmap"}),
}
_FIELDS = {field.name: str(field.type) for field in dataclasses.fields(Manifest)}


def manifest_path(model: Path) -> Path:
    """Where the manifest of an ONNX model lies: the same name with .toml."""
    return model.with_suffix(".toml")


def read_manifest(path: Path) -> dict[str, Any]:
    """The settings that a manifest states, checked one by one; fields of Manifest.

    Raises ModelError for a file that cannot be read or is not TOML, for an unknown key, and for
    a value of the wrong type or out of range.
    """
    try:
        with path.open("rb") as file:
            stated = tomllib.load(file)
    except OSError as error:
        raise ModelError(f"{path}: the manifest cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: the manifest is not TOML: {error}") from error
    return checked_settings(stated, where=str(path))


def checked_settings(stated: dict[str, Any], *, where: str) -> dict[str, Any]:
    """Settings of a manifest with every key known and every value of its type and range."""
    unknown = sorted(set(stated) - set(_FIELDS))
    if unknown:
        raise ModelError(
            f"{where}: unknown manifest key {', '.join(map(repr, unknown))}; "
            f"known: {', '.join(_FIELDS)}"
        )
    settings: dict[str, Any] = {}
    for key, value in stated.items():
        settings[key] = tuple(map(float, value)) if _is_triple(value) else value
        problem = _problem(key, settings[key])
        if problem:
            raise ModelError(f"{where}: {key}: {problem}")
    check_keys_fit(settings, settings.get("kind"), settings.get("form"), where=where)
    return settings


def check_keys_fit(
    stated: Mapping[str, Any], kind: str | None, form: str | None, *, where: str
) -> None:
    """Raise ModelError for a stated key that this kind or form of model (None: any) has not."""
    for key in stated:
        if kind and not _belongs(_KINDS_OF_KEY, key, kind):
            raise ModelError(f"{where}: {key} has no meaning for a model of kind {kind!r}")
        if form and not _belongs(_FORMS_OF_KEY, key, form):
            raise ModelError(f"{where}: {key} has no meaning for the output form {form!r}")


def _belongs(owners: Mapping[str, frozenset[str]], key: str, owner: str) -> bool:
    return key not in owners or owner in owners[key]


def write_manifest(path: Path, manifest: Manifest, *, overwrite: bool = False) -> None:
    """Write a complete manifest as TOML. Raises OutputError where it cannot be written."""
    lines = toml_lines(settings_of(manifest))
    with written_whole(path, overwrite=overwrite) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def settings_of(manifest: Manifest) -> dict[str, Any]:
    """The settings of a manifest that have a meaning for its model."""
    settings = {key: getattr(manifest, key) for key in _FIELDS}
    return {
        key: value
        for key, value in settings.items()
        if value is not None
        and _belongs(_KINDS_OF_KEY, key, manifest.kind)
        and _belongs(_FORMS_OF_KEY, key, manifest.form)
        and (not key.startswith("padding") or manifest.resize == "letterbox")
    }


def toml_lines(settings: Mapping[str, Any]) -> list[str]:
    """Settings of a manifest as lines of TOML."""

    def text(value: Any) -> str:
        # A JSON string, number or list of numbers is the same in TOML, but for one character.
        plain = list(value) if isinstance(value, tuple) else value
        return json.dumps(plain, ensure_ascii=False).replace("\x7f", "\\u007f")

    return [f"{key} = {text(value)}" for key, value in settings.items()]


def _is_triple(value: Any) -> bool:
    return (
        isinstance(value, list | tuple)
        and len(value) == 3
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    )


def _problems(manifest: Manifest) -> list[tuple[str, str]]:
    found = []
    for key in _FIELDS:
        value = getattr(manifest, key)
        problem = None if value is None else _problem(key, value)
        if problem:
            found.append((key, problem))
    if manifest.kind in _FINDS_KEYPOINTS and manifest.skeleton is None:
        found.append(("skeleton", f"missing; known: {', '.join(skeletons.names())}"))
    return found


def _problem(key: str, value: Any) -> str | None:
    """What is wrong with a value of a key, or None."""
    kind_of_value = _FIELDS[key].split(" | ")[0]
    if key in _CHOICES:
        return None if value in _CHOICES[key] else f"{value!r}, expected one of {_CHOICES[key]}"
    if key == "skeleton":
        known = skeletons.names()
        return None if value in known else f"unknown {value!r}; known: {', '.join(known)}"
    if kind_of_value == "Triple":
        if not _is_triple(value):
            return f"{value!r}, expected three numbers"
        if not all(math.isfinite(number) for number in value):
            return f"{value!r} holds a value that is not finite"
        return "holds a zero, expected three numbers > 0" if key == "std" and 0 in value else None
    if kind_of_value == "str":
        return None if isinstance(value, str) else f"{value!r}, expected a string"
    is_number = isinstance(value, int if kind_of_value == "int" else int | float)
    if not is_number or isinstance(value, bool):
        return f"{value!r}, expected a{'n integer' if kind_of_value == 'int' else ' number'}"
    low, high = _RANGES[key]
    return None if low <= value <= high else f"{value}, expected {low} to {high}"
