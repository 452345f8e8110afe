"""`dance2pose export`: a result in the forms of other programs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dance2pose.export.forms import find_form


def export(
    result: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    video: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Write a result in the form of another program; the suffix of the output says which.

    bvh, glb, c3d, trc, mot, csv, long.csv, keypoints.csv, parquet, json, nc (movement), mp4, eaf
    (ELAN), phrases.csv.

    Parameters
    ----------
    result
        The poses .npz of a result (or its .rrd); further dancers and keypoints are read from the
        files beside it.
    output
        The file to write; where the form holds one dancer, the others go beside it as
        OUT.dancer_N.
    video
        The video of the result: needed for mp4, linked in eaf.
    overwrite
        Replace files that dance2pose wrote.
    quiet
        Say nothing.
    """
    find_form(output)  # before anything heavy is imported or read
    from dance2pose.export.loading import load_scene, poses_file
    from dance2pose.export.writing import write

    scene = load_scene(result, video=video)
    written = write(scene, output, overwrite=overwrite, inputs=(poses_file(result),))
    if not quiet:
        for note in written.notes:
            print(f"note: {note}", file=sys.stderr)
        for path in written.files:
            print(f"wrote {path}")
