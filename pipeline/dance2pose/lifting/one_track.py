"""One track to 3D in its camera's axes: what a lifter is given, and its answer made a track."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import BODY_HEIGHT_MM, Body
from dance2pose.body_file import body_for
from dance2pose.errors import DataError, UsageError
from dance2pose.lifting.implausible import implausible
from dance2pose.lifting.lifted import Lifted, Lifter, Observed
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.lifting.world.perspective import camera_of
from dance2pose.limits import model as limits
from dance2pose.options import Lifter as LifterName
from dance2pose.options import LiftOptions
from dance2pose.poses import BoolArray, FloatArray, Track2D, Track3D, Unit
from dance2pose.viewpoint import Viewpoint

# Ten thousand frames a second: times that are closer are in another unit.
SHORTEST_STEP_S = 1e-4


def lift_track(
    track: Track2D,
    options: LiftOptions,
    independent: bool,
    bodies: Mapping[str, Body] | None,
    motion: CameraMotion | None,
) -> tuple[Track3D, Body | None]:
    """The poses of a track, and the dancer's body where the lifter finds one."""
    per_mm = (options.height_m or 1.0) / BODY_HEIGHT_MM
    unit: Unit = "body heights" if options.height_m is None else "metres"
    observed = observe(
        track,
        independent=independent,
        camera=_usable_model(track, options),
        fov_deg=options.fov_deg,
        body=body_for(bodies, track.person) if bodies else None,
    )
    if motion is not None and not independent:
        observed = replace(observed, motion=motion.at(track.frame))
    seen = np.isfinite(observed.xy).all(axis=2)
    lifted = _lifter(options.lifter)(observed) if seen.any() else _nothing(observed)
    return _as_track(track, observed, lifted, per_mm, unit), lifted.body


def observe(
    track: Track2D,
    *,
    independent: bool = False,
    camera: str = "weak-perspective",
    fov_deg: float | None = None,
    body: Body | None = None,
) -> Observed:
    """The track as lifters take it: in its lifting skeleton, with y up, and without keypoints
    that no body could have put there. Checks what it is given."""
    source = skeletons.get(track.skeleton)
    if len(track) == 0:
        raise DataError(f"track of person {track.person}: holds no frame; there is nothing to lift")
    if track.xy.shape[1] != len(source):
        raise DataError(
            f"track of person {track.person}: {track.xy.shape[1]} keypoints, "
            f"{source.name} has {len(source)}"
        )
    if np.isinf(track.xy).any() or not np.isfinite(track.confidence).all():
        raise DataError(
            f"track of person {track.person}: infinite keypoints, or a confidence that is not a "
            "number; a keypoint that is missing is NaN with confidence 0"
        )
    step_s = float(np.median(np.diff(track.time_s))) if len(track) > 1 else np.inf
    if step_s < SHORTEST_STEP_S and not independent:
        raise DataError(
            f"track of person {track.person}: its frames are {step_s:.2g} s apart, expected times "
            f"in seconds, {SHORTEST_STEP_S:g} apart at least"
        )
    target = skeletons.lifting_skeleton(source.name)
    own = "cmu17" if target.name == "paper15" else target.name
    if body is not None and body.skeleton != own:
        raise UsageError(
            f"track of person {track.person}: the body given is of {body.skeleton}, but the track "
            f"is lifted as {own}; bones of the one are not bones of the other"
        )
    xy, confidence = skeletons.convert(
        track.xy.astype(np.float64),
        track.confidence.astype(np.float64),
        source=source.name,
        target=target.name,
    )
    if not independent:
        wrong = implausible(xy, track.time_s, target.name)
        xy[wrong], confidence[wrong] = np.nan, 0.0
    return Observed(
        xy=xy * np.array([1.0, -1.0]),
        confidence=np.maximum(confidence, 0.0),
        time_s=track.time_s,
        skeleton=target.name,
        image_size=track.image_size,
        independent=independent,
        camera=camera,
        fov_deg=fov_deg,
        body=body,
    )


def _usable_model(track: Track2D, options: LiftOptions) -> str:
    """The camera model for a track: a perspective camera needs the size of its picture."""
    model = options.camera_model
    if model != "perspective" or min(track.image_size) > 0:
        return model
    if options.camera == "auto":
        return "weak-perspective"
    raise UsageError(
        f"track of person {track.person}: the size of its picture is not known, which a "
        "perspective camera needs; give the size, or take the weak-perspective camera"
    )


def _as_track(
    track: Track2D, observed: Observed, lifted: Lifted, per_mm: float, unit: Unit
) -> Track3D:
    seen = np.isfinite(observed.xy).all(axis=2)
    known = np.isfinite(lifted.xyz).all(axis=2)
    error = np.linalg.norm(lifted.projected - observed.xy, axis=2)
    return Track3D(
        person=track.person,
        timeline=track.timeline,
        xyz=np.multiply(lifted.xyz, per_mm, dtype=np.float64),
        unit=unit,
        skeleton=observed.skeleton,
        reprojection_error=error,
        valid=_valid(lifted.xyz, observed.skeleton),
        estimated=known & ~(seen & (observed.confidence > 0)),
        sigma=None if lifted.sigma is None else np.multiply(lifted.sigma, per_mm, dtype=np.float64),
        root=None if lifted.root is None else lifted.root * per_mm,
        shot=track.shot,
        viewpoint=None if lifted.root is None else _viewpoint(observed),
    )


def _viewpoint(observed: Observed) -> Viewpoint:
    """The camera in its own axes."""
    frames = len(observed)
    camera = camera_of(observed.image_size, observed.fov_deg)
    rotation: FloatArray = np.broadcast_to(np.eye(3), (frames, 3, 3))
    zoom: FloatArray = np.ones(frames)
    if observed.motion is not None:
        rotation, zoom = observed.motion.rotation, observed.motion.zoom
    return Viewpoint(rotation, np.zeros(3), camera.focal_px * zoom, observed.image_size)


def _lifter(name: LifterName) -> Lifter:
    """Imported when it is asked for: the default one brings its network with it."""
    if name == "paper":
        from dance2pose.lifting.pursuit.paper import lift_frames

        return lift_frames
    from dance2pose.lifting.temporal import sequence

    return sequence.lift_frames


def _nothing(observed: Observed) -> Lifted:
    frames, joints = observed.confidence.shape
    root = np.full((frames, 3), np.nan) if observed.camera == "perspective" else None
    projected = np.full((frames, joints, 2), np.nan)
    return Lifted(np.full((frames, joints, 3), np.nan), projected, root=root)


def _valid(xyz: FloatArray, skeleton: str) -> BoolArray:
    return limits.load(skeleton).is_valid(xyz)
