"""A video read once: its people joined into tracks, its shots, and how its camera moved."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dance2pose.background_motion import CameraMotionEstimator
from dance2pose.beside import Beside
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.options import Settings
from dance2pose.people import PoseModels, find_people
from dance2pose.poses import FloatArray, Frame, Timeline
from dance2pose.profiling import stage
from dance2pose.progress import Progress
from dance2pose.results import Shot
from dance2pose.small_picture import Grey
from dance2pose.tracking.settings import TrackingSettings
from dance2pose.tracking.tracker import Tracker
from dance2pose.video import FrameReader

FrameListener = Callable[[Frame], None]


@dataclass(frozen=True)
class VideoTracks:
    """The people of a video, joined into tracks, the frames in which they were looked for, and how
    the camera moved."""

    tracker: Tracker
    timeline: Timeline
    shots: tuple[Shot, ...]
    motion: CameraMotion


def track_people(
    frames: FrameReader,
    models: PoseModels,
    settings: Settings,
    on_frame: FrameListener | None,
    progress: Progress,
) -> VideoTracks:
    """Read the video once: people and keypoints of every frame, joined into tracks."""
    tracking = TrackingSettings()
    if settings.min_confidence is not None:
        tracking = replace(tracking, min_confidence=settings.min_confidence)
    tracker = Tracker(models.skeleton, frames.info.size, tracking)
    camera = CameraMotionEstimator(frames.info.size, settings.lift.fov_deg)
    seen, times = array("q"), array("d")
    starts: list[int] = []
    found = find_people(frames, models, settings.speed)
    with Beside("camera") as beside:
        for people in progress.track(
            found, "detecting and estimating", total=frames.expected_frames, unit="frame"
        ):
            frame = people.frame
            if people.cut or not starts:
                starts.append(len(seen))
            seen.append(frame.index)
            times.append(frame.time_s)
            # The picture itself is not held until the camera's turn comes.
            seen_by = frame.index, frame.time_s, frame.small, people.boxes.xyxy
            beside.call(partial(_follow_camera, camera, *seen_by, cut=people.cut))
            with stage("tracking"):
                tracker.update(
                    frame.index,
                    frame.time_s,
                    people.boxes,
                    people.poses,
                    cut=people.cut,
                    image=frame.image,
                )
            if on_frame is not None:
                with stage("recording"):
                    on_frame(frame)
        beside.finish()
    indices = np.array(seen, np.int64)
    timeline = Timeline(indices, np.array(times, np.float64))
    ends = [*starts[1:], len(seen)]
    return VideoTracks(
        tracker,
        timeline,
        tuple(
            Shot(number, int(indices[start]), int(indices[end - 1]))
            for number, (start, end) in enumerate(zip(starts, ends, strict=False))
        ),
        camera.finish(),
    )


def _follow_camera(
    camera: CameraMotionEstimator,
    index: int,
    time_s: float,
    picture: Grey,
    boxes: FloatArray,
    *,
    cut: bool,
) -> None:
    with stage("camera motion"):
        camera.update(index, time_s, picture, boxes, cut=cut)
