"""Lifting dancers' keypoints to 3D: each track by itself, then the room that a camera shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import BODY_HEIGHT_MM, Body
from dance2pose.body_file import read_bodies
from dance2pose.lifting.jumps import doubted_where_keypoints_jump
from dance2pose.lifting.one_track import lift_track
from dance2pose.lifting.world.field_of_view import FieldOfView, estimated_fov
from dance2pose.lifting.world.ground_plane import levelled
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.lifting.world.perspective import ASSUMED_FOV, ASSUMED_FOV_DEG
from dance2pose.options import LiftOptions, combined
from dance2pose.portions import portions, track_rows
from dance2pose.poses import Track2D, Track3D


def lift(
    track: Track2D,
    options: LiftOptions | None = None,
    *,
    independent: bool = False,
    **named: Any,
) -> Track3D:
    """The 3D poses of one dancer.

    Parameters
    ----------
    track
        2D keypoints of one dancer; `Track2D.from_arrays` makes one from plain arrays.
    options
        How to lift; its fields can also be given by name (`height_m=1.62`).
    independent
        The frames are unrelated pictures, so that nothing flows between them.
    **named
        Fields of `LiftOptions`.

    Returns
    -------
    Track3D
        Joints of the track's lifting skeleton, (T, 17, 3) in body heights, or in metres where a
        height was given; see `lift_all`.

    Raises
    ------
    UsageError
        For an unknown skeleton or option.
    DataError
        For a track whose arrays do not fit its skeleton.

    Examples
    --------
    >>> import numpy as np
    >>> xy = np.random.default_rng(0).uniform(0, 480, (7, 17, 2))
    >>> track = Track2D.from_arrays(
    ...     xy, time_s=np.arange(7) / 25, skeleton="coco17", image_size=(640, 480)
    ... )
    >>> lift(track, height_m=1.7).xyz.shape
    (7, 17, 3)
    """
    return lift_all([track], options, independent=independent, **named)[0]


def known_bodies(options: LiftOptions) -> dict[str, Body] | None:
    """The bodies that the options name a file of. Raises DataError where it is none."""
    return None if options.body is None else read_bodies(options.body)


def lift_all(
    tracks: Sequence[Track2D],
    options: LiftOptions | None = None,
    *,
    independent: bool = False,
    bodies: Mapping[str, Body] | None = None,
    motion: CameraMotion | None = None,
    **named: Any,
) -> list[Track3D]:
    """The 3D poses of the dancers in one video, one for every frame of each track.

    The result is in the tracks' lifting skeleton (body17 for keypoint skeletons), first joint at
    the origin; frames of which nothing is known are NaN. World axes are as the camera sees them,
    and where the path through the room is found, with the floor level at y = 0 for all dancers of
    a shot (`world.ground_plane`). Parameters and errors as in `lift`; bodies: bone lengths known
    before, by the persons' numbers, those of a single dancer being everybody's
    (`body_file.body_for`); motion: how the camera turns and zooms (`background_motion`), None where
    it stands still.
    """
    return lift_with_bodies(
        tracks, options, independent=independent, bodies=bodies, motion=motion, **named
    )[0]


def lift_with_bodies(
    tracks: Sequence[Track2D],
    options: LiftOptions | None = None,
    *,
    independent: bool = False,
    bodies: Mapping[str, Body] | None = None,
    motion: CameraMotion | None = None,
    **named: Any,
) -> tuple[list[Track3D], list[Body | None]]:
    """As `lift_all`, and the bone lengths found for each track, None where the lifter finds none:
    in unrelated pictures, and with the paper's lifter."""
    options = combined(LiftOptions, options, named)
    bodies = known_bodies(options) if bodies is None else bodies
    lifted, found_bodies = _lift_each(tracks, options, independent, bodies, motion)
    if independent:  # every picture has a camera of its own
        return lifted, found_bodies
    found = dict(enumerate(lifted))
    del lifted
    per_unit = BODY_HEIGHT_MM / (options.height_m or 1.0)
    for shot in sorted({track.shot for track in tracks}):
        rows = [n for n, track in enumerate(tracks) if track.shot == shot]
        fov = _told_fov([found[n] for n in rows], options, per_unit)
        if fov is not None:
            for n in rows:  # an hour of poses is not held twice
                del found[n]
            again = _lift_with_fov([tracks[n] for n in rows], fov, options, bodies)
            found.update(zip(rows, again, strict=True))
            del again
        found.update(zip(rows, levelled([found[n] for n in rows], per_unit), strict=True))
    for n, track in enumerate(tracks):
        found[n] = doubted_where_keypoints_jump(_reprojected(found[n], track), track)
    return [found[n] for n in range(len(tracks))], found_bodies


def _told_fov(
    found: Sequence[Track3D], options: LiftOptions, per_unit: float
) -> FieldOfView | None:
    """The field of view that the tracks of one shot tell; None where they do not, or it is known.

    Where the camera moves, its turns were told with the field of view that is assumed.
    """
    moves = any(track.viewpoint is not None and track.viewpoint.moves for track in found)
    if options.fov_deg is not None or moves:
        return None
    return estimated_fov(found, per_unit, ASSUMED_FOV_DEG)


def _lift_with_fov(
    tracks: Sequence[Track2D],
    fov: FieldOfView,
    options: LiftOptions,
    bodies: Mapping[str, Body] | None,
) -> list[Track3D]:
    """The tracks of one shot lifted again with the field of view that they told."""
    again = lift_in_camera(tracks, replace(options, fov_deg=fov.degrees), bodies=bodies)
    return [
        track
        if track.viewpoint is None
        else replace(track, viewpoint=replace(track.viewpoint, fov_error_deg=fov.error_deg))
        for track in again
    ]


def _reprojected(poses: Track3D, track: Track2D) -> Track3D:
    """The poses with the error of where their camera sees them now that they are on the floor."""
    if poses.viewpoint is None or poses.root is None:
        return poses
    error = np.empty_like(poses.reprojection_error)
    for rows in portions(len(track)):
        part = track_rows(poses, rows)
        assert part.viewpoint is not None
        seen, _ = skeletons.convert(
            track.xy[rows].astype(np.float64),
            track.confidence[rows],
            source=track.skeleton,
            target=poses.skeleton,
        )
        drawn = part.viewpoint.project(part.world_xyz)
        error[rows] = np.linalg.norm(drawn - seen, axis=2)
    # Keypoints that no body could have put there are left out, as they were in lifting.
    error[np.isnan(poses.reprojection_error)] = np.nan
    return replace(poses, reprojection_error=error)


def lift_in_camera(
    tracks: Sequence[Track2D],
    options: LiftOptions | None = None,
    *,
    independent: bool = False,
    bodies: Mapping[str, Body] | None = None,
    motion: CameraMotion | None = None,
    **named: Any,
) -> list[Track3D]:
    """As `lift_all`, but poses and paths stay in the camera's axes: x right, y up, z towards the
    viewer, the camera at the origin of the paths."""
    options = combined(LiftOptions, options, named)
    return _lift_each(tracks, options, independent, bodies, motion)[0]


def _lift_each(
    tracks: Sequence[Track2D],
    options: LiftOptions,
    independent: bool,
    bodies: Mapping[str, Body] | None,
    motion: CameraMotion | None,
) -> tuple[list[Track3D], list[Body | None]]:
    both = [lift_track(track, options, independent, bodies, motion) for track in tracks]
    return [track for track, _ in both], [body for _, body in both]


def describe_camera(
    options: LiftOptions,
    motion: CameraMotion | None = None,
    lifted: Sequence[Track3D] = (),
) -> str:
    """The camera model of a run, and what it assumes, as a phrase for its provenance."""
    if options.camera_model == "weak-perspective":
        return "weak-perspective: poses without a path through the room"
    known = "as given" if options.fov_deg is not None else ASSUMED_FOV
    told = {
        f"{seen.fov_deg:.0f} degrees across the longer side of the picture, give or take "
        f"{seen.fov_error_deg:.0f}, as upright dancers and the floor under their feet tell"
        for seen in (track.viewpoint for track in lifted)
        if seen is not None and seen.fov_error_deg is not None
    }
    if told:
        known = "; ".join(sorted(told))
    moves = motion is not None and motion.moves
    stands = "turning on the spot as its background shows" if moves else "standing still"
    return f"perspective and {stands}, field of view {known}"
