"""The whole chain for one video: start reading here.

`analyse` reads a video once and gives all that is known of its dancers; it writes nothing.
`reconstruct` is `analyse` and the files that come of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose import smoothing
from dance2pose.background_motion import CameraMotionEstimator
from dance2pose.errors import VideoError
from dance2pose.findings import find
from dance2pose.lifting.lift import describe_camera, lift_all
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.onnx_models.answers import losses
from dance2pose.options import OutputOptions, Settings, combined
from dance2pose.people import PoseModels, find_people, load_models
from dance2pose.poses import Dancer, Frame, Timeline, Track2D
from dance2pose.profiling import stage
from dance2pose.progress import Progress, Silent
from dance2pose.provenance import describe_run, file_sha256, identity_of
from dance2pose.results import Result, Shot, Source
from dance2pose.saving import open_recording, plan_run, save, write_beside
from dance2pose.tracking.tracker import Tracker, TrackingSettings
from dance2pose.video import FrameReader, open_video

FrameListener = Callable[[Frame], None]


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


@dataclass(frozen=True)
class Summary:
    """What came of a run, for the person at the terminal and for a batch's ledger."""

    files: tuple[Path, ...]
    dancers: int
    frames: int
    frames_with_pose: int
    shares: tuple[float, ...]
    mean_confidence: float
    share_invalid_bones: float
    notes: tuple[str, ...]

    @property
    def recording(self) -> Path:
        return self.files[0]

    @property
    def share_with_pose(self) -> float:
        return self.frames_with_pose / self.frames if self.frames else 0.0


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
    inputs = (Path(video), settings.detector, settings.pose)
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
    for note in models.notes:
        progress.say(f"note: {note}")
    followed = _follow(frames, models, settings, on_frame, progress)
    lost = losses(models.accounts, first_time_s=float(followed.timeline.time_s[0]))
    tracks = followed.tracker.finish(settings.person)
    if not tracks:
        raise VideoError(
            f"{frames.info.path}: no person was found in any of {frames.frames_read} frames; "
            f"nothing was written. {models.describe_reading()}. "
            "--min-confidence counts less sure ones too"
        )
    progress.say(f"lifting {len(tracks)} dancer{'s' if len(tracks) > 1 else ''} to 3D")
    dancers = to_3d(tracks, settings, followed.motion)
    source = Source(
        frames.info, file_sha256(frames.info.path), followed.timeline, frames.deinterlaced
    )
    everyone = followed.tracker.finish("all")
    said = (*frames.warnings, *models.notes, *lost, *followed.motion.notes())
    findings = (*said, *find(dancers, everyone, source.timeline))
    provenance = describe_run(
        source.info,
        models,
        settings,
        dancers,
        frames_read=len(source.timeline),
        stages={
            "camera": describe_camera(
                settings.lift, followed.motion, [dancer.raw for dancer in dancers]
            ),
            "deinterlaced": "yes" if source.deinterlaced else "no",
            **models.hardware,
        },
        warnings=findings,
    )
    return Reconstruction(source, followed.shots, tuple(dancers), provenance, findings)


@dataclass(frozen=True)
class _Followed:
    """The people of a video, joined into tracks, the frames in which they were looked for, and how
    the camera moved."""

    tracker: Tracker
    timeline: Timeline
    shots: tuple[Shot, ...]
    motion: CameraMotion


def _follow(
    frames: FrameReader,
    models: PoseModels,
    settings: Settings,
    on_frame: FrameListener | None,
    progress: Progress,
) -> _Followed:
    """Read the video once: people and keypoints of every frame, joined into tracks."""
    tracking = TrackingSettings()
    if settings.min_confidence is not None:
        tracking = replace(tracking, min_confidence=settings.min_confidence)
    tracker = Tracker(models.skeleton, frames.info.size, tracking)
    camera = CameraMotionEstimator(frames.info.size, settings.lift.fov_deg)
    seen: list[tuple[int, float]] = []
    starts: list[int] = []
    found = find_people(frames, models, settings.speed)
    for people in progress.track(
        found, "detecting and estimating", total=frames.expected_frames, unit="frame"
    ):
        frame = people.frame
        if people.cut or not starts:
            starts.append(len(seen))
        seen.append((frame.index, frame.time_s))
        with stage("tracking"):
            tracker.update(
                frame.index,
                frame.time_s,
                people.boxes,
                people.poses,
                cut=people.cut,
                image=frame.image,
            )
        with stage("camera motion"):
            camera.update(frame, people.boxes.xyxy, cut=people.cut)
        if on_frame is not None:
            with stage("recording"):
                on_frame(frame)
    indices = np.array([index for index, _ in seen], np.int64)
    timeline = Timeline(indices, np.array([time for _, time in seen], np.float64))
    ends = [*starts[1:], len(seen)]
    return _Followed(
        tracker,
        timeline,
        tuple(
            Shot(number, int(indices[start]), int(indices[end - 1]))
            for number, (start, end) in enumerate(zip(starts, ends, strict=False))
        ),
        camera.finish(),
    )


def to_3d(
    tracks: Sequence[Track2D], settings: Settings, motion: CameraMotion | None = None
) -> list[Dancer]:
    """Lift the dancers' keypoints and smooth the joints over time."""
    with stage("lifting"):
        lifted = lift_all(tracks, settings.lift, motion=motion)
    model, window = settings.smooth.model_after(settings.lift.lifter), settings.smooth.window
    return [
        Dancer(
            track,
            raw,
            raw if model == "none" else smoothing.smooth_track(raw, model=model, window=window),
        )
        for track, raw in zip(tracks, lifted, strict=True)
    ]


def summarise(result: Result, files: Sequence[Path], notes: Sequence[str] = ()) -> Summary:
    """The figures of a result, as a person reads them at the end of a run."""
    frames = len(result.source.timeline)
    seen: set[int] = set()
    shares = []
    for dancer in result.dancers:
        has_pose = ~np.isnan(dancer.keypoints.xy).all(axis=(1, 2))
        seen.update(dancer.keypoints.frame[has_pose].tolist())
        shares.append(float(has_pose.sum()) / frames)
    tracks = [dancer.keypoints for dancer in result.dancers]
    confidence = np.concatenate([t.confidence[~np.isnan(t.xy).any(axis=2)] for t in tracks])
    raw = [dancer.raw for dancer in result.dancers]
    valid = np.concatenate([r.valid[~np.isnan(r.xyz).all(axis=(1, 2))].ravel() for r in raw])
    return Summary(
        files=tuple(files),
        dancers=len(tracks),
        frames=frames,
        frames_with_pose=len(seen),
        shares=tuple(shares),
        mean_confidence=float(confidence.mean()) if confidence.size else float("nan"),
        share_invalid_bones=float(1 - valid.mean()) if valid.size else float("nan"),
        notes=(*result.findings, *notes),
    )
