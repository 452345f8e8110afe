"""The whole chain for one video: start reading here.

`analyse` reads a video once and gives all that is known of its dancers; it writes nothing.
`reconstruct` is `analyse` and the files that come of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dance2pose import smoothing
from dance2pose.body import Body
from dance2pose.errors import VideoError
from dance2pose.file_hash import file_sha256
from dance2pose.findings import find
from dance2pose.lifting.lift import describe_camera, known_bodies, lift_with_bodies
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.onnx_models.answers import losses
from dance2pose.options import OutputOptions, Settings, combined
from dance2pose.people import PoseModels, load_models
from dance2pose.poses import Dancer, Track2D
from dance2pose.profiling import stage
from dance2pose.progress import Progress, Silent
from dance2pose.provenance import describe_run, identity_of
from dance2pose.results import Result, Source
from dance2pose.saving import open_recording, plan_run, save, write_beside
from dance2pose.summary import Summary, summarise
from dance2pose.video import FrameReader, open_video
from dance2pose.video_tracks import FrameListener, track_people


class Reconstruction(Result):
    """What `analyse` found in a video.

    Attributes
    ----------
    source : Source
        The video, and the timeline of every frame that was processed.
    shots : tuple of Shot
        The stretches between cuts.
    dancers : tuple of Dancer
        Each with `keypoints` (Track2D), `raw` and `smoothed` (Track3D).
    provenance : Provenance
        Source, models, settings and what was done.
    findings : tuple of str
        What a reader must know before use.
    """

    def save(self, path: Path | str, *, overwrite: bool = False, **options: Any) -> list[Path]:
        """Write what was found; the suffix of the name decides the form.

        `.rrd` is a recording for the viewer, `.npz` the poses and, beside them, the keypoints as
        plain arrays; `dance2pose.export` lists the other forms. A further dancer N goes to
        `NAME.dancer_N.suffix` where a form holds one.

        Parameters
        ----------
        path
            The file to write.
        overwrite
            Replace files that dance2pose wrote.
        **options
            Fields of `OutputOptions`, such as `picture`.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        UsageError
            For a suffix that no form has, or a name that is the video's own.
        OutputError
            For what the file system refuses; then nothing was written.
        """
        return save(self, Path(path), combined(OutputOptions, None, options), overwrite=overwrite)


def analyse(
    video: Path | str,
    settings: Settings | None = None,
    *,
    on_frame: FrameListener | None = None,
    models: PoseModels | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Reconstruction:
    """Find the dancers of a video and lift them to 3D. Nothing is written.

    Parameters
    ----------
    video
        The video file.
    settings
        All settings; single ones can be given by name instead (`detector="d.onnx"`, `end_s=3`).
    on_frame
        Called with every processed frame in order, while the video is read.
    models
        Models that are loaded already, instead of those that the settings name.
    progress
        Where progress is shown.
    **options
        Fields of `Settings` and of its groups.

    Returns
    -------
    Reconstruction
        The source, shots, dancers and provenance; `.save(path)` writes files.

    Raises
    ------
    UsageError
        For options that are not possible, and models that are not named; before any work.
    Dance2PoseError
        For anything that can be the matter with the video or the models.

    Examples
    --------
    >>> r = analyse("tape.mp4", detector="d.onnx", pose="p.onnx")  # doctest: +SKIP
    >>> r.dancers[0].smoothed.xyz.shape  # doctest: +SKIP
    (545, 17, 3)
    """
    settings = combined(Settings, settings, options)
    known_bodies(settings.lift)
    with _opened(Path(video), settings) as frames:
        models = models or load_models(settings)
        return _analyse(frames, models, settings, on_frame, progress or Silent())


def reconstruct(
    video: Path | str,
    output: Path | str,
    settings: Settings | None = None,
    *,
    outputs: OutputOptions | None = None,
    overwrite: bool = False,
    models: PoseModels | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Summary:
    """Reconstruct the dancers of `video` into the recording `output` and the files beside it.

    Parameters
    ----------
    video, settings, models, progress, **options
        As in `analyse`.
    output
        The recording to write, a name that ends in .rrd.
    outputs
        What is written beside it.
    overwrite
        Replace files that dance2pose wrote.

    Returns
    -------
    Summary
        The files, and what they hold in figures.

    Raises
    ------
    Dance2PoseError
        For anything that can be the matter with the video, the models or the output; then no
        output file is left behind, and files of an earlier run are as they were.
    """
    settings, outputs = combined(Settings, settings, options), outputs or OutputOptions()
    progress = progress or Silent()
    known_bodies(settings.lift)  # a file that is none is found before any work
    inputs = (Path(video), settings.detector, settings.pose, settings.lift.body)
    plan = plan_run(Path(output), outputs, inputs=inputs, overwrite=overwrite)
    with _opened(Path(video), settings) as frames:
        models = models or load_models(settings)
        with plan.writing() as staged:
            with open_recording(
                staged.path(plan.main),
                frames.info,
                outputs,
                identity=identity_of(frames.info, models.descriptions, settings),
                deinterlaced=frames.deinterlaced,
            ) as recording:
                progress.say(f"picture in the recording: {recording.picture}")
                found = _analyse(frames, models, settings, recording.picture_frame, progress)
                with stage("recording"):
                    recording.write(found.dancers, found.provenance, found.source.timeline)
            with stage("recording"):
                notes = write_beside(found, plan, staged)
    return summarise(found, staged.files, notes)


def _opened(video: Path, settings: Settings) -> FrameReader:
    options = settings.video
    return open_video(
        video,
        start_s=options.start_s,
        end_s=options.end_s,
        every=options.every,
        deinterlace=options.deinterlace,
    )


def _analyse(
    frames: FrameReader,
    models: PoseModels,
    settings: Settings,
    on_frame: FrameListener | None,
    progress: Progress,
) -> Reconstruction:
    bodies = known_bodies(settings.lift)  # a file that is none is found before any work
    for note in models.notes:
        progress.say(f"note: {note}")
    followed = track_people(frames, models, settings, on_frame, progress)
    frames.close()  # what follows needs memory and no pictures
    timeline, motion = followed.timeline, followed.motion
    lost = losses(models.accounts, first_time_s=float(timeline.time_s[0]))
    tracks = followed.tracker.finish(settings.person)
    if not tracks:
        raise VideoError(
            f"{frames.info.path}: no person was found in any of {frames.frames_read} frames; "
            f"nothing was written. {models.describe_reading()}. "
            "--min-confidence counts less sure ones too"
        )
    progress.say(f"lifting {len(tracks)} dancer{'s' if len(tracks) > 1 else ''} to 3D")
    # Who asked for one person knows that others are left out.
    everyone = followed.tracker.finish("all") if settings.person == "auto" else []
    numbers = {track.person for track in tracks}
    left_out = [track for track in everyone if track.person not in numbers]
    shots = followed.shots
    del followed, everyone
    dancers, found_bodies = to_3d(tracks, settings, bodies, motion)
    source = Source(frames.info, file_sha256(frames.info.path), timeline, frames.deinterlaced)
    said = (*frames.warnings, *models.notes, *lost, *motion.notes())
    findings = (*said, *find(dancers, left_out, source.timeline))
    provenance = describe_run(
        source.info,
        models,
        settings,
        dancers,
        frames_read=len(source.timeline),
        stages={
            "camera": describe_camera(settings.lift, motion, [dancer.raw for dancer in dancers]),
            "deinterlaced": "yes" if source.deinterlaced else "no",
            **models.hardware,
        },
        warnings=findings,
    )
    return Reconstruction(source, shots, tuple(dancers), provenance, findings, found_bodies)


def to_3d(
    tracks: Sequence[Track2D],
    settings: Settings,
    bodies: Mapping[str, Body] | None,
    motion: CameraMotion,
) -> tuple[list[Dancer], dict[str, Body]]:
    """Lift the dancers' keypoints and smooth the joints over time.

    bodies: bone lengths known before. Returns the dancers, and the bone lengths found, by number.
    """
    with stage("lifting"):
        lifted, found = lift_with_bodies(tracks, settings.lift, bodies=bodies, motion=motion)
    model, window = settings.smooth.model_after(settings.lift.lifter), settings.smooth.window
    with stage("smoothing"):
        dancers = [
            Dancer(track, raw, smoothing.smooth_track(raw, model=model, window=window))
            for track, raw in zip(tracks, lifted, strict=True)
        ]
    by_number = {
        str(track.person): body
        for track, body in zip(tracks, found, strict=True)
        if body is not None
    }
    return dancers, by_number
