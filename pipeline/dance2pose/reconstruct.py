"""The whole chain for one video: frames, people, keypoints, tracks, 3D, smoothing, recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose import exchange, smoothing
from dance2pose.config import Settings
from dance2pose.errors import VideoError
from dance2pose.lifting.lift import describe_camera, lift_all
from dance2pose.output_files import check_output
from dance2pose.people import PoseModels, find_ahead, load_models
from dance2pose.poses import Dancer, Track2D, Track3D
from dance2pose.progress import Progress, Silent
from dance2pose.provenance import Provenance, describe_run
from dance2pose.recording.writer import RecordingWriter, choose_picture, recording_id_for
from dance2pose.shots import ShotDetector
from dance2pose.tracking.tracker import Tracker
from dance2pose.video import FrameReader, open_video


@dataclass(frozen=True)
class Summary:
    """What came of a run, for the person at the terminal and for a batch's ledger."""

    recording: Path
    files: tuple[Path, ...]
    dancers: int
    frames: int
    frames_with_pose: int
    mean_confidence: float
    share_invalid_bones: float
    notes: tuple[str, ...]

    @property
    def share_with_pose(self) -> float:
        return self.frames_with_pose / self.frames if self.frames else 0.0


def reconstruct(
    video: Path,
    output: Path,
    *,
    settings: Settings,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Summary:
    """Reconstruct the dancers of `video` into the recording `output` and its .npz files.

    Raises a Dance2PoseError for anything that can be the matter with the video, the models or the
    output; then no output file is left behind.
    """
    progress = progress or Silent()
    smoothing.check_window(settings.temporal_model, settings.window)
    for path in (output, *(_npz_paths(output, None) if settings.npz else ())):
        check_output(path, overwrite=overwrite)
    with open_video(
        video,
        start_s=settings.start,
        end_s=settings.end,
        every=settings.every,
        deinterlace=settings.deinterlace,
    ) as frames:
        models = load_models(settings)
        picture, reason = choose_picture(frames.info, settings.picture, frames.deinterlaced)
        progress.say(f"picture in the recording: {picture} ({reason})")
        with RecordingWriter(
            output,
            recording_id=recording_id_for(frames.info, settings),
            picture=picture,
            video=frames.info,
            overwrite=overwrite,
        ) as recording:
            tracks = observe(frames, models, recording, settings=settings, progress=progress)
            progress.say(f"lifting {len(tracks)} of the dancers found to 3D")
            dancers = to_3d(tracks, settings)
            stages = {
                "picture": f"{picture}: {reason}",
                "camera": describe_camera(settings.camera, settings.lifter, settings.fov),
            }
            provenance = describe_run(frames, models, settings, dancers, stages=stages)
            recording.write(dancers, provenance)
            files = _write_npz(output, dancers, settings, overwrite=overwrite)
    return _summary(output, files, dancers, frames.frames_read, provenance)


def observe(
    frames: FrameReader,
    models: PoseModels,
    recording: RecordingWriter,
    *,
    settings: Settings,
    progress: Progress,
) -> list[Track2D]:
    """Read the video once: people and keypoints of every frame, joined into tracks."""
    shots = ShotDetector()
    tracker: Tracker | None = None
    found = find_ahead(frames, models)
    for frame, (boxes, poses) in progress.track(
        found, "detecting and estimating", total=frames.expected_frames, unit="frame"
    ):
        if tracker is None:
            height, width = frame.image.shape[:2]
            tracker = Tracker(models.skeleton, (width, height))
        tracker.update(
            frame.index,
            frame.time_s,
            boxes,
            poses,
            cut=shots.is_cut(frame),
            image=frame.image,
        )
        recording.picture_frame(frame)
    tracks = tracker.finish(settings.person) if tracker else []
    if not tracks:
        raise VideoError(
            f"{frames.info.path}: no person was found in any of {frames.frames_read} frames; "
            "nothing was written"
        )
    return tracks


def to_3d(tracks: Sequence[Track2D], settings: Settings) -> list[Dancer]:
    """Lift the dancers' keypoints and smooth the joints over time."""
    found = lift_all(
        tracks,
        lifter=settings.lifter,
        height_m=settings.height,
        camera=settings.camera,
        fov_deg=settings.fov,
    )
    return [
        Dancer(track, raw, _smoothed(raw, settings))
        for track, raw in zip(tracks, found, strict=True)
    ]


def _smoothed(raw: Track3D, settings: Settings) -> Track3D:
    model = settings.temporal_model
    if model == "none":
        return raw
    return smoothing.smooth_track(raw, model=model, window=settings.window)


def _npz_paths(output: Path, person: int | None) -> tuple[Path, Path]:
    """Where poses and keypoints go: OUT.npz for the first dancer (None), OUT.dancer_2.npz ..."""
    stem = output.stem if person is None else f"{output.stem}.dancer_{person}"
    return output.with_name(f"{stem}.npz"), output.with_name(f"{stem}.track.npz")


def _write_npz(
    output: Path, dancers: Sequence[Dancer], settings: Settings, *, overwrite: bool
) -> list[Path]:
    if not settings.npz:
        return []
    others = [_npz_paths(output, dancer.person) for dancer in dancers[1:]]
    paths = [_npz_paths(output, None), *others]
    files = [path for pair in paths for path in pair]
    for path in files:
        check_output(path, overwrite=overwrite)
    for (poses, track), dancer in zip(paths, dancers, strict=True):
        exchange.write_poses(poses, dancer.smoothed, overwrite=overwrite)
        exchange.write_track(track, dancer.track, overwrite=overwrite)
    return files


def _summary(
    output: Path,
    files: Sequence[Path],
    dancers: Sequence[Dancer],
    frames: int,
    provenance: Provenance,
) -> Summary:
    seen: set[int] = set()
    for dancer in dancers:
        has_pose = ~np.isnan(dancer.track.xy).all(axis=(1, 2))
        seen.update(dancer.track.frame[has_pose].tolist())
    confidence = np.concatenate(
        [d.track.confidence[~np.isnan(d.track.xy).any(axis=2)] for d in dancers]
    )
    lifted = [d.raw.valid[~np.isnan(d.raw.xyz).all(axis=(1, 2))] for d in dancers]
    valid = np.concatenate([v.ravel() for v in lifted])
    return Summary(
        recording=output,
        files=(output, *files),
        dancers=len(dancers),
        frames=frames,
        frames_with_pose=len(seen),
        mean_confidence=float(confidence.mean()) if confidence.size else float("nan"),
        share_invalid_bones=float(1 - valid.mean()) if valid.size else float("nan"),
        notes=tuple(provenance.warnings),
    )
