"""Writing a scene into the files of one form, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dance2pose.errors import UsageError
from dance2pose.export.extras import need
from dance2pose.export.forms import Form, find_form
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.outputs import plan_outputs
from dance2pose.poses import Track3D


class Written(NamedTuple):
    """What came of an export. notes: what a reader of the files must know that they cannot say."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]


def write(
    result: Any, path: Path | str, *, overwrite: bool = False, inputs: tuple[Path, ...] = ()
) -> Written:
    """Write a result in the form that the suffix of `path` names.

    Parameters
    ----------
    result
        An `ExportScene`, a `Track3D`, or a `Result` (of `analyse`).
    path
        The file to write. A form of one dancer gives one file each: OUT.bvh, OUT.dancer_2.bvh.
    overwrite
        Replace files that dance2pose wrote.
    inputs
        Files that the result was read from, which are never replaced.

    Raises
    ------
    UsageError
        For an unknown suffix, a missing package, or what the result lacks.
    OutputError
        For what the file system refuses; then nothing is left behind.

    Examples
    --------
    >>> write(load_scene(Path("dance.npz")), "dance.bvh").files  # doctest: +SKIP
    """
    scene, path = scene_of(result), Path(path)
    form = find_form(path)
    check(form, scene)
    plan = plan_outputs(
        path, kinds=(form.suffix,), inputs=[*inputs, scene.video], overwrite=overwrite
    )
    with plan.writing() as staged:
        notes = write_form(form, scene, lambda person: staged.path(plan.name(form.suffix, person)))
    return Written(staged.files, notes)


def write_form(
    form: Form, scene: ExportScene, place: Callable[[int | None], Path]
) -> tuple[str, ...]:
    """Write one form to where `place` says: of None for the first file (or the only one), of the
    number of the dancer for the others. Returns the notes."""
    if form.several_dancers:
        return form.write(place(None), scene)
    notes: dict[str, None] = {}
    for dancer in scene.dancers:
        first = dancer is scene.dancers[0]
        found = form.write(place(None if first else dancer.person), scene.alone(dancer))
        who = f"dancer {dancer.person}: " if len(scene.dancers) > 1 else ""
        notes.update(dict.fromkeys(f"{who}{note}" for note in found))
    return tuple(notes)


def check(form: Form, scene: ExportScene | None = None) -> None:
    """Raise UsageError where the form needs a package that is missing, or what the scene lacks."""
    if form.package and form.extra:
        need(form.package, form.extra)
    if scene is None:
        return
    if form.needs_video and scene.video is None:
        source = scene.provenance.get("source")
        name = source.get("file_name") if isinstance(source, Mapping) else None
        where = f"its video, {name}, is not beside the result" if name else "no video is known"
        raise UsageError(f"{form.name}: {where}; give it with --video")
    if form.needs_keypoints and any(p.keypoints is None for p in scene.dancers):
        raise UsageError(
            f"{form.name}: the result has no keypoints; they are read from its .track.npz files"
        )


def scene_of(result: Any) -> ExportScene:
    """A result as a scene."""
    if isinstance(result, ExportScene):
        return result
    if isinstance(result, Track3D):
        return ExportScene.of(result)
    dancers = tuple(SceneDancer(d.smoothed, d.keypoints) for d in result.dancers)
    return ExportScene(dancers, result.source.path, result.about())
