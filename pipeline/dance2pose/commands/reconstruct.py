"""What runs behind `dance2pose VIDEO`: the chain, and the summary that a person reads."""

from __future__ import annotations

import shlex
from pathlib import Path

from dance2pose import progress as progress_display
from dance2pose.config import Settings
from dance2pose.reconstruct import Summary, reconstruct


def run(
    video: Path, output: Path | None, settings: Settings, *, overwrite: bool, quiet: bool
) -> None:
    """Reconstruct one video with progress, then say what came of it."""
    display = progress_display.for_terminal(quiet=quiet)
    summary = reconstruct(
        video,
        output or Path(f"{video.stem}.rrd"),
        settings=settings,
        overwrite=overwrite,
        progress=display,
    )
    if not quiet:
        print("\n".join(summary_lines(summary)))


def summary_lines(summary: Summary) -> list[str]:
    """The lines at the end of a run."""
    dancers = "dancer" if summary.dancers == 1 else "dancers"
    lines = [
        f"{summary.dancers} {dancers} in {summary.frames} frames; "
        f"{summary.frames_with_pose} frames with a pose ({summary.share_with_pose:.1%})",
        f"mean keypoint confidence {summary.mean_confidence:.2f}; "
        f"{summary.share_invalid_bones:.1%} of bones outside the joint-angle limits",
        *(f"note: {note}" for note in summary.notes),
        *(f"wrote {path}" for path in summary.files),
        f"open it with: dance2pose view {shlex.quote(str(summary.recording))}",
    ]
    return lines
