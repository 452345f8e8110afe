"""`dance2pose lift`: 2D keypoints of any tool to 3D poses."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import write_poses
from dance2pose.lifting import lift_all
from dance2pose.output_files import check_output
from dance2pose.pose_files import read_tracks
from dance2pose.poses import Track3D


def lift(
    track: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    lifter: Literal["default", "paper"] = "default",
    camera: Literal["auto", "weak-perspective", "perspective"] = "auto",
    fov: float | None = None,
    height: float | None = None,
    independent: bool = False,
    frame_rate: float | None = None,
    skeleton: str | None = None,
    image_size: tuple[int, int] | None = None,
    person: str = "auto",
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Lift 2D keypoints of any tool to 3D poses.

    Parameters
    ----------
    track
        A track .npz, a folder of OpenPose JSON files, or a COCO keypoint .json.
    output
        The .npz to write; further dancers go beside it as OUT.dancer_N.npz.
    lifter
        default looks at the whole track; paper lifts every frame alone.
    camera
        Camera model; perspective, which auto is but for the paper's lifter, also solves the path
        of the dancer through the room.
    fov
        Horizontal field of view in degrees, for the perspective camera; assumed if not given.
    height
        Body height of the dancer in metres; without it, lengths are in body heights.
    independent
        The frames are unrelated pictures; nothing flows between them.
    frame_rate
        Pictures a second; JSON files do not tell it.
    skeleton
        Skeleton of the keypoints, where their number does not tell it.
    image_size
        Width and height of the picture in pixels, where the file does not tell it.
    person
        Whose poses: auto, all, largest, central or a number; a track .npz holds one dancer.
    overwrite
        Replace files that exist.
    quiet
        Say nothing.
    """
    if output.suffix.lower() != ".npz":
        raise UsageError(f"{output}: poses are written as .npz; give a name that ends so")
    if fov is not None and not 5 <= fov <= 170:
        raise UsageError(f"--fov {fov}: expected degrees, 5 to 170")
    check_output(output, overwrite=overwrite)
    tracks = read_tracks(
        track,
        frame_rate=frame_rate,
        skeleton=skeleton,
        image_size=image_size,
        person=person,
        independent=independent,
    )
    if not tracks:
        raise DataError(f"{track}: no person is in it long enough to be followed")
    found = lift_all(
        tracks,
        lifter=lifter,
        height_m=height,
        independent=independent,
        camera=camera,
        fov_deg=fov,
    )
    for poses in found:
        if np.isnan(poses.xyz).all():
            raise DataError(
                f"{track}: person {poses.person}: no frame has enough keypoints to be lifted"
            )
    names = [_name(output, poses, first=poses is found[0]) for poses in found]
    for name in names[1:]:
        check_output(name, overwrite=overwrite)
    for name, poses in zip(names, found, strict=True):
        write_poses(name, poses, overwrite=overwrite)
        if not quiet:
            print(_summary(poses), file=sys.stderr)
            print(f"wrote {name}")


def _name(output: Path, poses: Track3D, *, first: bool) -> Path:
    return output if first else output.with_name(f"{output.stem}.dancer_{poses.person}.npz")


def _summary(poses: Track3D) -> str:
    lifted = ~np.isnan(poses.xyz).all(axis=(1, 2))
    return (
        f"dancer {poses.person}: {lifted.sum()} of {len(poses)} frames lifted ({poses.skeleton}, "
        f"{poses.unit}); mean reprojection error {np.nanmean(poses.reprojection_error):.2f} px; "
        f"{1 - poses.valid[lifted].mean():.1%} of bones outside the joint-angle limits"
    )
