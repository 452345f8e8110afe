"""What an ONNX model is: recognised from its graph, completed and corrected by its manifest."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dance2pose import skeleton as skeletons
from dance2pose.errors import ModelError
from dance2pose.file_hash import file_sha256
from dance2pose.onnx_models.detector_forms import DETECTOR_FORMS
from dance2pose.onnx_models.forms import (
    Graph,
    Match,
    OutputForm,
    is_extra_input,
)
from dance2pose.onnx_models.inference import (
    Array,
    Session,
    TensorInfo,
    check_model_file,
    open_session,
)
from dance2pose.onnx_models.manifest import (
    MAX_INPUT_SIDE,
    Kind,
    Layout,
    Manifest,
    check_keys_fit,
    manifest_path,
    read_manifest,
)
from dance2pose.onnx_models.one_stage_forms import ONE_STAGE_FORMS
from dance2pose.onnx_models.pose_forms import POSE_FORMS
from dance2pose.onnx_models.registry import located
from dance2pose.skeleton import SKELETONS_BY_COUNT

# In the order in which they are tried: the more particular before the more general.
FORMS: dict[str, OutputForm] = {
    form.name: form for form in (*ONE_STAGE_FORMS, *POSE_FORMS, *DETECTOR_FORMS)
}

# The input of a detector or one-stage model whose graph and manifest leave its size open.
_OPEN_SIZE = (640, 640)


@dataclass(frozen=True)
class ModelDescription:
    """A model, recognised.

    reasons: why it is read as it is. assumed: what was taken for granted because no graph shows
    it. roles: role -> output of the graph. keypoints: how many the model gives, None for a
    detector. stated: the manifest's own settings.
    """

    path: Path
    sha256: str
    size_bytes: int
    kind: Kind
    form: str
    reasons: tuple[str, ...]
    assumed: tuple[str, ...]
    manifest: Manifest
    roles: Mapping[str, str]
    keypoints: int | None
    inputs: tuple[TensorInfo, ...]
    outputs: tuple[TensorInfo, ...]
    manifest_file: Path | None = None


def inspect_model(path: Path, manifest: Path | None = None) -> ModelDescription:
    """Recognise a model. path: the model or its manifest. manifest: where not beside the model.

    Raises ModelError for a model that cannot be loaded or is not recognised.
    """
    return open_model(path, manifest=manifest)[1]


def open_model(
    path: Path,
    *,
    manifest: Path | None = None,
    threads: int | None = None,
    provider: str = "cpu",
) -> tuple[Session, ModelDescription]:
    """Load a model and recognise it; as `inspect_model`, with the session to run it."""
    model, manifest = _files(path, manifest)
    stated = read_manifest(manifest) if manifest else {}
    session = open_session(model, threads=threads, provider=provider)
    return session, _describe(session, stated, manifest)


def _files(path: Path, manifest: Path | None) -> tuple[Path, Path | None]:
    """The ONNX file and its manifest, if any, from either of the two or a pulled model's name."""
    path = located(path)
    if path.suffix.lower() == ".toml":
        manifest = path
        name = read_manifest(path).get("model")
        model = path.parent / name if name else path.with_suffix(".onnx")
        try:
            check_model_file(model)
        except ModelError as error:
            raise ModelError(f"{path}: its model cannot be used: {error}") from error
        return model, manifest
    check_model_file(path)
    if manifest is None and manifest_path(path).is_file():
        manifest = manifest_path(path)
    return path, manifest


def _describe(
    session: Session, stated: dict[str, Any], manifest_file: Path | None
) -> ModelDescription:
    path = session.path
    image = _image_input(session)
    layout: Layout = stated.get("layout") or _layout(path, image)
    fixed = _fixed_size(image, layout)
    size = _stated_size(stated, fixed) or _metadata_size(session)
    _check_input_size(path, size or _OPEN_SIZE, fixed)
    graph = Graph(
        session, image, layout, *(size or _OPEN_SIZE), form_is_stated=stated.get("form") is not None
    )
    form, match = _recognise(graph, stated)
    where = str(manifest_file or path)
    check_keys_fit(stated, form.kind, form.name, where=where)
    width, height = size or match.default_size or _OPEN_SIZE
    settings: dict[str, Any] = {"layout": layout, **match.preset}
    if match.keypoints is not None and "skeleton" not in settings:
        settings["skeleton"] = _skeleton(path, match.keypoints, stated)
    settings |= stated
    settings |= {"kind": form.kind, "form": form.name, "input_width": width, "input_height": height}
    try:
        manifest = Manifest(**settings)
    except ValueError as error:
        raise ModelError(f"{where}: {error}") from error
    _check(path, manifest, match)
    return ModelDescription(
        path=path,
        sha256=file_sha256(path),
        size_bytes=path.stat().st_size,
        kind=form.kind,
        form=form.name,
        reasons=(*match.reasons, *_skeleton_reason(match, stated)),
        assumed=tuple(match.assumed) if not stated else (),
        manifest=manifest,
        roles=match.roles,
        keypoints=match.keypoints,
        inputs=session.inputs,
        outputs=session.outputs,
        manifest_file=manifest_file,
    )


def _recognise(graph: Graph, stated: dict[str, Any]) -> tuple[OutputForm, Match]:
    wanted = stated.get("form")
    if wanted is not None and wanted not in FORMS:
        raise ModelError(
            f"{graph.session.path}: the manifest states an unknown form {wanted!r}; "
            f"known: {', '.join(FORMS)}"
        )
    kind = stated.get("kind")
    candidates = [FORMS[wanted]] if wanted else list(FORMS.values())
    for form in candidates:
        match = form.match(graph) if kind in (None, form.kind) else None
        if match is not None:
            return form, match
    seen = "; ".join(map(_with_range, graph.outputs, graph.probe))
    asked = f" of form {wanted}" if wanted else f" of kind {kind}" if kind else ""
    known = "; ".join(f"{form.name} ({form.kind}): {form.summary}" for form in candidates)
    raise ModelError(
        f"{graph.session.path}: not recognised as a model{asked}. Outputs seen: {seen}, "
        f"for an input of {graph.width}x{graph.height}. Forms known: {known}"
    )


def _with_range(tensor: TensorInfo, values: Array) -> str:
    """An output and what its values span, for the one who must say what it is."""
    if not values.size or values.dtype.kind == "b":
        return str(tensor)
    return f"{tensor} ({values.min():.4g} to {values.max():.4g} on grey)"


def _image_input(session: Session) -> TensorInfo:
    """The input that takes the picture; ModelError where there is not exactly one."""
    pictures = [t for t in session.inputs if len(t.shape) == 4]
    others = [t for t in session.inputs if len(t.shape) != 4 and not is_extra_input(t)]
    if len(pictures) != 1 or others:
        seen = "; ".join(map(str, session.inputs)) or "none"
        raise ModelError(
            f"{session.path}: inputs seen: {seen}; expected one picture [batch, 3, height, width] "
            f"or [batch, height, width, 3]"
        )
    return pictures[0]


def _layout(path: Path, image: TensorInfo) -> Layout:
    if image.shape[1] == 3:
        return "NCHW"
    if image.shape[3] == 3:
        return "NHWC"
    if 1 in (image.shape[1], image.shape[3]):
        raise ModelError(f"{path}: input {image} takes grey pictures; expected 3 colours")
    if image.shape[1] is None and image.shape[3] is None:
        return "NCHW"
    raise ModelError(f"{path}: input {image} has no axis of 3 colours; expected a picture")


def _fixed_size(image: TensorInfo, layout: Layout) -> tuple[int | None, int | None]:
    """(width, height) as the graph has them, None where it leaves them open."""
    _, a, b, c = image.shape
    return (c, b) if layout == "NCHW" else (b, a)


def _stated_size(
    stated: dict[str, Any], fixed: tuple[int | None, int | None]
) -> tuple[int, int] | None:
    width = stated.get("input_width") or fixed[0]
    height = stated.get("input_height") or fixed[1]
    return (width, height) if width and height else None


def _metadata_size(session: Session) -> tuple[int, int] | None:
    """The size that Ultralytics' exports were made for."""
    try:
        height, width = ast.literal_eval(session.metadata["imgsz"])
    except (KeyError, ValueError, SyntaxError, TypeError):
        return None
    return int(width), int(height)


def _skeleton(path: Path, keypoints: int, stated: dict[str, Any]) -> str:
    if keypoints in SKELETONS_BY_COUNT:
        return SKELETONS_BY_COUNT[keypoints][0]
    if "skeleton" in stated:
        return str(stated["skeleton"])
    known = ", ".join(f"{names[0]} ({n})" for n, names in SKELETONS_BY_COUNT.items())
    raise ModelError(f"{path}: gives {keypoints} keypoints; skeletons known: {known}")


def _skeleton_reason(match: Match, stated: dict[str, Any]) -> list[str]:
    if match.keypoints is None:
        return []
    if "skeleton" in stated:
        return [f"skeleton {stated['skeleton']}: stated by the manifest"]
    first, *others = SKELETONS_BY_COUNT.get(match.keypoints, ("",))
    hint = f" (if it is {' or '.join(others)}, say so in the manifest)" if others else ""
    return [f"{match.keypoints} keypoints: {first}{hint}"]


def _check_input_size(
    path: Path, size: tuple[int, int], fixed: tuple[int | None, int | None]
) -> None:
    """What a manifest states must fit the graph, before a picture of that size is made."""
    if any(want not in (None, have) for want, have in zip(fixed, size, strict=True)):
        raise ModelError(
            f"{path}: takes pictures of {fixed[0] or '?'}x{fixed[1] or '?'} px, but its manifest "
            f"says {size[0]}x{size[1]}"
        )
    if max(size) > MAX_INPUT_SIDE:
        raise ModelError(f"{path}: takes pictures of {size[0]}x{size[1]} px, too large to run")


def _check(path: Path, manifest: Manifest, match: Match) -> None:
    """What a manifest states must fit what the graph is."""
    if match.classes is not None and manifest.person_class >= match.classes:
        raise ModelError(
            f"{path}: tells {match.classes} classes apart, but its manifest says that a person "
            f"is number {manifest.person_class} (counted from 0)"
        )
    if match.keypoints is not None and manifest.skeleton is not None:
        joints = len(skeletons.get(manifest.skeleton))
        # Body and feet come first in a whole body, and may be all that is wanted.
        wanted, whole = (
            skeletons.get(manifest.skeleton),
            SKELETONS_BY_COUNT.get(match.keypoints, ()),
        )
        fits = any(skeletons.get(name).joints[:joints] == wanted.joints for name in whole)
        if joints != match.keypoints and not fits:
            raise ModelError(
                f"{path}: gives {match.keypoints} keypoints, but {manifest.skeleton} has {joints}"
            )
    if (manifest.resize == "crop") != (manifest.kind == "pose"):
        raise ModelError(
            f"{path}: resize {manifest.resize!r} does not fit a model of kind {manifest.kind!r}: "
            f"crop is for pose models, letterbox and stretch for the others"
        )
