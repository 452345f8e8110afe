"""Lifting one dancer's keypoints to 3D: the lifters by name, and all that they share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.errors import DataError, UsageError
from dance2pose.lifting.lifted import Lifted, Lifter, Observed
from dance2pose.lifting.world.ground_plane import levelled
from dance2pose.lifting.world.perspective import ASSUMED_FOV
from dance2pose.limits import model as limits
from dance2pose.poses import BoolArray, FloatArray, Track2D, Track3D, Unit

# Each is imported when it is asked for: the default one brings its network with it.
LIFTERS = ("default", "paper")
CAMERAS = ("auto", "weak-perspective", "perspective")


def lift(
    track: Track2D,
    *,
    lifter: str = "default",
    height_m: float | None = None,
    independent: bool = False,
    camera: str = "auto",
    fov_deg: float | None = None,
) -> Track3D:
    """The 3D poses of one dancer; see `lift_all`."""
    return lift_all(
        [track],
        lifter=lifter,
        height_m=height_m,
        independent=independent,
        camera=camera,
        fov_deg=fov_deg,
    )[0]


def lift_all(
    tracks: Sequence[Track2D],
    *,
    lifter: str = "default",
    height_m: float | None = None,
    independent: bool = False,
    camera: str = "auto",
    fov_deg: float | None = None,
) -> list[Track3D]:
    """The 3D poses of the dancers in one video, one for every frame of each track.

    lifter: "paper" lifts every frame alone by pursuit over a pose dictionary; "default" looks at
    the whole track. height_m: the dancers' body height, for a result in metres; without it the
    unit is the body height. independent: the frames are unrelated pictures, so that nothing flows
    between them. camera, fov_deg: the camera model, and its horizontal field of view in degrees
    where that is known; see `camera_model`.

    The result is in the tracks' lifting skeleton (body17 for keypoint skeletons), first joint at
    the origin; frames of which nothing is known are NaN. World axes are as the camera sees them,
    and where the path through the room is found, with the floor level at y = 0 for all dancers of
    a shot (`levelling`). Raises UsageError for an unknown skeleton, lifter, camera or a height that
    is no body height, DataError for a track whose arrays do not fit its skeleton.
    """
    found = lift_in_camera(
        tracks,
        lifter=lifter,
        height_m=height_m,
        independent=independent,
        camera=camera,
        fov_deg=fov_deg,
    )
    if independent:  # every picture has a camera of its own
        return found
    out: dict[int, Track3D] = {}
    for shot in sorted({track.shot for track in tracks}):
        rows = [n for n, track in enumerate(tracks) if track.shot == shot]
        level = levelled([found[n] for n in rows], BODY_HEIGHT_MM / (height_m or 1.0))
        out.update(zip(rows, level, strict=True))
    return [out[n] for n in range(len(found))]


def lift_in_camera(
    tracks: Sequence[Track2D],
    *,
    lifter: str = "default",
    height_m: float | None = None,
    independent: bool = False,
    camera: str = "auto",
    fov_deg: float | None = None,
) -> list[Track3D]:
    """As `lift_all`, but poses and paths stay in the camera's axes: x right, y up, z towards the
    viewer, the camera at the origin of the paths."""
    if height_m is not None and not 0.3 <= height_m <= 3:
        raise UsageError(f"body height of {height_m} m; expected metres, 0.3 to 3")
    model = camera_model(camera, lifter)
    per_mm = (height_m or 1.0) / BODY_HEIGHT_MM
    unit: Unit = "body heights" if height_m is None else "metres"
    found = []
    for track in tracks:
        usable = _usable_model(model, track, asked=camera)
        observed = observe(track, independent=independent, camera=usable, fov_deg=fov_deg)
        found.append(_lift_one(track, observed, _lifter(lifter), per_mm, unit))
    return found


def _usable_model(model: str, track: Track2D, *, asked: str) -> str:
    if model != "perspective" or min(track.image_size) > 0:
        return model
    if asked == "auto":
        return "weak-perspective"
    raise UsageError(
        f"track of person {track.person}: the size of its picture is not known, which a "
        "perspective camera needs; give the size, or take the weak-perspective camera"
    )


def _lift_one(
    track: Track2D, observed: Observed, lift_frames: Lifter, per_mm: float, unit: Unit
) -> Track3D:
    seen = np.isfinite(observed.xy).all(axis=2)
    lifted = lift_frames(observed) if seen.any() else _nothing(observed)
    known = np.isfinite(lifted.xyz).all(axis=2)
    error = np.linalg.norm(lifted.projected - observed.xy, axis=2)
    return Track3D(
        person=track.person,
        frame=track.frame,
        time_s=track.time_s,
        xyz=lifted.xyz * per_mm,
        unit=unit,
        skeleton=observed.skeleton,
        reprojection_error=error,
        valid=_valid(lifted.xyz, observed.skeleton),
        estimated=known & ~(seen & (observed.confidence > 0)),
        sigma=None if lifted.sigma is None else lifted.sigma * per_mm,
        root=None if lifted.root is None else lifted.root * per_mm,
    )


def camera_model(camera: str, lifter: str) -> str:
    """What "auto" stands for: perspective, as real cameras are, where the lifter can (and, in
    `lift`, where the size of the picture is known).

    Video lifted as if it were orthographic has half as large an error again, and a field of view
    that is assumed wrongly by a third costs far less than none (models/README.md).
    """
    if camera not in CAMERAS:
        raise UsageError(f"unknown camera {camera!r}; known: {', '.join(CAMERAS)}")
    if camera != "auto":
        return camera
    return "weak-perspective" if lifter == "paper" else "perspective"


def describe_camera(camera: str, lifter: str, fov_deg: float | None) -> str:
    """The camera model of a run, and what it assumes, as a phrase for its provenance."""
    if camera_model(camera, lifter) == "weak-perspective":
        return "weak-perspective: poses without a path through the room"
    known = "as given" if fov_deg is not None else ASSUMED_FOV
    return f"perspective and standing still, field of view {known}"


def observe(
    track: Track2D,
    *,
    independent: bool = False,
    camera: str = "weak-perspective",
    fov_deg: float | None = None,
) -> Observed:
    """The track as lifters take it: in its lifting skeleton, with y up. Checks what it is given."""
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
    target = skeletons.lifting_skeleton(source.name)
    xy, confidence = skeletons.convert(
        track.xy.astype(np.float64),
        track.confidence.astype(np.float64),
        source=source.name,
        target=target.name,
    )
    return Observed(
        xy=xy * np.array([1.0, -1.0]),
        confidence=np.maximum(confidence, 0.0),
        time_s=track.time_s,
        skeleton=target.name,
        image_size=track.image_size,
        independent=independent,
        camera=camera,
        fov_deg=fov_deg,
    )


def _lifter(name: str) -> Lifter:
    if name == "paper":
        from dance2pose.lifting.pursuit.paper import lift_frames

        return lift_frames
    if name == "default":
        from dance2pose.lifting.temporal import sequence

        return sequence.lift_frames
    raise UsageError(f"unknown lifter {name!r}; known: {', '.join(LIFTERS)}")


def _nothing(observed: Observed) -> Lifted:
    frames, joints = observed.confidence.shape
    root = np.full((frames, 3), np.nan) if observed.camera == "perspective" else None
    projected = np.full((frames, joints, 2), np.nan)
    return Lifted(np.full((frames, joints, 3), np.nan), projected, root=root)


def _valid(xyz: FloatArray, skeleton: str) -> BoolArray:
    return limits.load(skeleton).is_valid(xyz)
