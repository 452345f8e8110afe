"""A result into files: which form a name asks for, and who writes it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from dance2pose import exchange, export
from dance2pose.body_file import write_bodies
from dance2pose.options import OutputOptions
from dance2pose.outputs import OutputPlan, Staged, plan_outputs
from dance2pose.poses import Dancer, Frame
from dance2pose.provenance import recording_id
from dance2pose.recording.picture import choose_picture
from dance2pose.recording.writer import RecordingWriter
from dance2pose.results import Result, Source
from dance2pose.video import VideoInfo, open_video

RECORDING, POSES, KEYPOINTS, BODY = ".rrd", ".npz", ".track.npz", ".body.toml"


def plan_run(
    output: Path,
    options: OutputOptions,
    *,
    inputs: Sequence[Path | None],
    overwrite: bool,
) -> OutputPlan:
    """Plan the files of `reconstruct`: the recording, and what stands beside it."""
    beside = [POSES, KEYPOINTS] if options.npz else []
    beside += [BODY] if options.write_body else []
    return plan_outputs(
        output,
        kinds=(RECORDING,),
        beside=[*beside, *_forms(options.forms)],
        inputs=inputs,
        overwrite=overwrite,
    )


def save(
    result: Result, path: Path, options: OutputOptions, *, overwrite: bool = False
) -> list[Path]:
    """Write a result in the form that the suffix of `path` names."""
    suffix = path.suffix.lower()
    if suffix not in (RECORDING, POSES):
        return list(export.write(result, path, overwrite=overwrite).files)
    plan = plan_outputs(
        path,
        kinds=(suffix,),
        beside=[KEYPOINTS] if suffix == POSES else [],
        inputs=[result.source.path],
        overwrite=overwrite,
    )
    with plan.writing() as staged:
        if suffix == RECORDING:
            _save_recording(result, staged.path(path), options)
        else:
            _write_npz(result, plan, staged)
    return list(staged.files)


def write_beside(result: Result, plan: OutputPlan, staged: Staged) -> tuple[str, ...]:
    """Write what the plan has beside the main file. Returns what a reader of the files must know
    that they cannot say."""
    if POSES in plan.beside:
        _write_npz(result, plan, staged)
    if BODY in plan.beside:
        write_bodies(staged.path(plan.name(BODY)), result.bodies, overwrite=True)
    notes: list[str] = []
    scene = export.scene_of(result)
    for suffix in plan.beside:
        if suffix in export.FORMS:
            form, place = export.FORMS[suffix], partial(_place, plan, staged, suffix)
            notes += [f"{form.name}: {note}" for note in export.write_form(form, scene, place)]
    return tuple(notes)


def _place(plan: OutputPlan, staged: Staged, suffix: str, person: int | None) -> Path:
    return staged.path(plan.name(suffix, person))


@contextmanager
def open_recording(
    path: Path,
    info: VideoInfo,
    options: OutputOptions,
    *,
    identity: str,
    deinterlaced: bool,
) -> Iterator[RecordingWriter]:
    """A recording of a video that is written to `path` when the block ends well.

    identity: of the run, see `provenance.identity_of`.
    """
    picture, reason = choose_picture(info, options.picture, deinterlaced)
    with RecordingWriter(
        path,
        recording_id=recording_id(identity, picture),
        picture=picture,
        video=info,
        reason=reason,
        overwrite=True,
    ) as recording:
        yield recording


def _forms(names: Sequence[str]) -> list[str]:
    """Suffixes of export forms, each known and with what it needs installed."""
    forms = [export.find_form(name) for name in names]
    for form in forms:
        export.check(form)
    return [form.suffix for form in forms]


def _save_recording(result: Result, path: Path, options: OutputOptions) -> None:
    """The recording of a result whose video was read before: frames that go into it as pictures
    are read again."""
    source = result.source
    with open_recording(
        path,
        source.info,
        options,
        identity=result.provenance.identity,
        deinterlaced=source.deinterlaced,
    ) as recording:
        if recording.records_frames:
            for frame in _frames_again(source):
                recording.picture_frame(frame)
        recording.write(result.dancers, result.provenance, source.timeline)


def _frames_again(source: Source) -> Iterator[Frame]:
    timeline = source.timeline
    wanted = set(timeline.frame.tolist())
    with open_video(
        source.path,
        start_s=float(timeline.time_s[0]),
        end_s=float(timeline.time_s[-1]),
        deinterlace="auto" if source.deinterlaced else "off",
    ) as frames:
        yield from (frame for frame in frames if frame.index in wanted)


def _write_npz(result: Result, plan: OutputPlan, staged: Staged) -> None:
    for dancer in result.dancers:
        _write_dancer(dancer, result, plan, staged)


def _write_dancer(dancer: Dancer, result: Result, plan: OutputPlan, staged: Staged) -> None:
    person = None if dancer is result.dancers[0] else dancer.person
    about = result.about()
    poses, track = (staged.path(plan.name(suffix, person)) for suffix in (POSES, KEYPOINTS))
    exchange.write_poses(poses, dancer.smoothed, provenance=about, overwrite=True)
    exchange.write_track(track, dancer.keypoints, provenance=about, overwrite=True)
