"""`dance2pose lift`: 2D keypoints of any tool to 3D poses."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from dance2pose.command_line import FLAT
from dance2pose.errors import DataError
from dance2pose.exchange import write_poses
from dance2pose.lifting import lift_all
from dance2pose.options import LiftOptions, Settings, parse_person
from dance2pose.outputs import plan_outputs
from dance2pose.poses import Track3D
from dance2pose.reading import MIN_CONFIDENCE, read_tracks


def lift(
    track: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    options: Annotated[LiftOptions | None, FLAT] = None,
    independent: bool = False,
    frame_rate: float | None = None,
    skeleton: str | None = None,
    image_size: tuple[int, int] | None = None,
    person: str = Settings.person,
    min_confidence: float = MIN_CONFIDENCE,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Lift 2D keypoints of any tool to 3D poses.

    Parameters
    ----------
    track
        A track .npz; JSON of OpenPose (a folder), COCO, AlphaPose, MMPose, rtmlib or MediaPipe;
        CSV or .h5 of DeepLabCut or SLEAP; a .csv with columns such as nose_x and nose_y.
    output
        The .npz to write; further dancers go beside it as OUT.dancer_N.npz.
    independent
        The frames are unrelated pictures; nothing flows between them.
    frame_rate
        Pictures a second, for files without times; most of other tools have none.
    skeleton
        Skeleton of the keypoints, where neither their names nor their number tell it.
    image_size
        Width and height of the picture in pixels, where the file does not tell it; without it no
        path through the room is found.
    person
        Whose poses: auto, all, largest, central or a number; a track .npz holds one dancer.
    min_confidence
        Keypoints less sure than this, 0 to 1, count as not seen.
    overwrite
        Replace files that dance2pose wrote.
    quiet
        Say nothing.
    """
    parse_person(person)
    inputs = [*track.iterdir()] if track.is_dir() else [track]
    plan = plan_outputs(output, kinds=(".npz",), inputs=inputs, overwrite=overwrite)
    read = read_tracks(
        track,
        frame_rate=frame_rate,
        skeleton=skeleton,
        image_size=image_size,
        person=person,
        independent=independent,
        min_confidence=min_confidence,
    )
    tracks = read.tracks
    if not quiet:
        for note in read.notes:
            print(f"note: {note}", file=sys.stderr)
    if not tracks:
        raise DataError(f"{track}: no person is in it long enough to be followed")
    found = lift_all(tracks, options, independent=independent)
    for poses in found:
        if np.isnan(poses.xyz).all():
            raise DataError(
                f"{track}: person {poses.person}: no frame has enough keypoints to be lifted"
            )
    about = {"tool": "dance2pose", "made from": track.name}
    with plan.writing() as staged:
        for poses in found:
            name = plan.name(".npz", None if poses is found[0] else poses.person)
            write_poses(staged.path(name), poses, provenance=about, overwrite=True)
    if quiet:
        return
    for poses, name in zip(found, staged.files, strict=True):
        print(_summary(poses), file=sys.stderr)
        print(f"wrote {name}")


def _summary(poses: Track3D) -> str:
    lifted = ~np.isnan(poses.xyz).all(axis=(1, 2))
    return (
        f"dancer {poses.person}: {lifted.sum()} of {len(poses)} frames lifted ({poses.skeleton}, "
        f"{poses.unit}); mean reprojection error {np.nanmean(poses.reprojection_error):.2f} px; "
        f"{1 - poses.valid[lifted].mean():.1%} of bones outside the joint-angle limits"
    )
