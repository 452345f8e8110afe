"""What runs behind `dance2pose VIDEO`: the chain, and the summary that a person reads."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from dance2pose import progress as progress_display
from dance2pose.options import OutputOptions, Settings
from dance2pose.profiling import Profile
from dance2pose.reconstruction import reconstruct
from dance2pose.summary import Summary


def run(
    video: Path,
    output: Path | None,
    settings: Settings,
    outputs: OutputOptions,
    *,
    overwrite: bool,
    quiet: bool,
    profiled: bool = False,
) -> None:
    """Reconstruct one video with progress, then say what came of it."""
    display = progress_display.for_terminal(quiet=quiet)
    with Profile() as profile:
        summary = reconstruct(
            video,
            output or default_output(video),
            settings,
            outputs=outputs,
            overwrite=overwrite,
            progress=display,
        )
    if profiled:
        print(profile.table(summary.frames), file=sys.stderr)
    if not quiet:
        print("\n".join(summary_lines(summary)))


def default_output(video: Path) -> Path:
    """The recording of a video in the present folder: `01.rrd` of `01.mp4` that lies here, and
    `a_01.rrd` of `a/01.mp4`, so that tapes of one name in two folders are two files."""
    folder = "" if video.parent == Path() else f"{video.resolve().parent.name}_"
    return Path(f"{folder}{video.stem}.rrd")


def summary_lines(summary: Summary) -> list[str]:
    """The lines at the end of a run."""
    dancers = "dancer" if summary.dancers == 1 else "dancers"
    each = ""
    if summary.dancers > 1:
        shares = ", ".join(f"{share:.1%}" for share in summary.shares)
        each = f"; each of them in {shares}"
    return [
        f"{summary.dancers} {dancers} in {summary.frames} frames; "
        f"{summary.frames_with_pose} frames with a pose ({summary.share_with_pose:.1%}){each}",
        f"mean keypoint confidence {summary.mean_confidence:.2f}; "
        f"{summary.share_invalid_bones:.1%} of bones outside the joint-angle limits",
        *(f"note: {note}" for note in summary.notes),
        *(f"wrote {path}" for path in summary.files),
        f"open it with: dance2pose view {shlex.quote(str(summary.recording))}",
    ]
