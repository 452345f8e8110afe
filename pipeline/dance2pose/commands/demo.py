"""`dance2pose demo`: the first minute, on any machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def demo(
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Run the bundled clip through the bundled models: no network, under a minute.

    The clip is rendered from motion capture, so that the demo can end with its own accuracy. Its
    models are small and made for it; real footage wants real ones (`dance2pose models list`).

    Parameters
    ----------
    output
        Folder for the recording and the other files; dance2pose-demo in this folder if not given.
    overwrite
        Replace files of an earlier demo.
    quiet
        Show no progress and no summary.
    """
    from dance2pose import progress
    from dance2pose.commands.reconstruct import summary_lines
    from dance2pose.demo import FOLDER, run_demo

    summary, accuracy = run_demo(
        output or FOLDER, overwrite=overwrite, progress=progress.for_terminal(quiet=quiet)
    )
    if quiet:
        return
    *lines, how_to_open = summary_lines(summary)
    print("\n".join(lines))
    print(
        f"against the clip's motion capture: {accuracy.pa_mpjpe_mm:.0f} mm PA-MPJPE over the "
        f"17 joints of body17, in {accuracy.frames_with_pose} of {accuracy.frames} frames; "
        f"{accuracy.pck:.1%} of the keypoints within 0.2 torso lengths"
    )
    print("the clip is rendered and its models are small; for real videos: dance2pose models list")
    print(how_to_open)
