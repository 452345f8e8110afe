"""`dance2pose batch`: a whole collection, one package a video."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

from dance2pose.archive.options import BatchOptions
from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.recipe import Recipe
from dance2pose.command_line import FLAT, SMOOTH_FLAT, SWITCHES_FLAT
from dance2pose.errors import Dance2PoseError
from dance2pose.options import (
    LiftOptions,
    OutputOptions,
    Settings,
    SmoothOptions,
    SpeedOptions,
    VideoOptions,
)
from dance2pose.progress import Progress, for_terminal


def batch(
    source: Path,
    archive: Path,
    *,
    detector: Path | None = None,
    pose: Path | None = None,
    person: str = Settings.person,
    lift: Annotated[LiftOptions | None, FLAT] = None,
    smooth: Annotated[SmoothOptions | None, SMOOTH_FLAT] = None,
    min_confidence: float | None = Settings.min_confidence,
    part: Annotated[VideoOptions | None, FLAT] = None,
    speed: Annotated[SpeedOptions | None, FLAT] = None,
    outputs: Annotated[OutputOptions | None, SWITCHES_FLAT] = None,
    options: Annotated[BatchOptions | None, FLAT] = None,
    quality: Annotated[QualityLimits | None, FLAT] = None,
    dry_run: bool = False,
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Turn a whole collection of videos into an archive of packages.

    The same command again goes on where it stopped: what is done with the same video, models
    and settings is left alone, what has changed is done again as a new version.

    Parameters
    ----------
    source
        A folder (walked), a list of file names, or a CSV table with a column filename; its other
        columns are settings of a video by the names of these options, and metadata (dc.title ...).
    archive
        The folder to write to; made if it is missing. The videos are never written to.
    detector
        ONNX person detector, or the TOML manifest beside it.
    pose
        ONNX keypoint model, or its TOML manifest; a one-stage model needs no detector.
    person
        Whose poses: auto (one dancer, or all where several dance), all, largest, central, or N.
    min_confidence
        Score, 0 to 1, from which people and keypoints count; as is usual for each model if not
        given.
    dry_run
        Say what would be done and how long it would take, from a short measurement.
    config
        TOML file of settings, named as the options are.
    quiet
        Show no progress and no summary.
    """
    del config  # read before the command line is parsed, see cli.main()
    display = for_terminal(quiet=quiet)
    settings = Settings(
        detector=detector,
        pose=pose,
        person=person,
        video=part or VideoOptions(),
        lift=lift or LiftOptions(),
        smooth=smooth or SmoothOptions(),
        speed=speed or SpeedOptions(),
        min_confidence=min_confidence,
    )
    recipe = Recipe(settings=settings, outputs=outputs or OutputOptions())
    if dry_run:
        _dry_run(source, archive, recipe, options or BatchOptions(), display)
        return
    from dance2pose.archive.running import run_batch

    result = run_batch(source, archive, recipe, options=options, quality=quality, progress=display)
    if not quiet:
        print(f"{result.tally.done} done, {result.failed_in_all} failed; {archive}")
    if result.failed_in_all:
        raise Dance2PoseError(
            f"{result.failed_in_all} items failed; `dance2pose status {archive}` says why"
        )


def _dry_run(
    source: Path, archive: Path, recipe: Recipe, options: BatchOptions, display: Progress
) -> None:
    """Print what would be done, one item a line, and an estimate of the hours."""
    from dance2pose.archive.estimating import estimate
    from dance2pose.archive.packages import one_line
    from dance2pose.archive.running import look_only

    with contextlib.closing(look_only(source, archive, recipe, display)) as ledger:
        items = list(ledger.items("waiting"))
        for item in items:
            again = f" (again, as version {item.version + 1})" if item.version else ""
            print(f"{item.item}: {one_line(' = '.join(item.names))}{again}")
        for item in ledger.items("failed"):
            print(f"{item.item}: not done: {one_line(item.error)}")
    found = estimate(items, recipe, options.local_workers) if items else None
    if found is None:
        print(f"{len(items)} to do")
        return
    print(
        f"{len(items)} to do, {found.frames} frames: about {found.hours:.2f} hours with "
        f"{options.local_workers} workers, at {found.seconds_a_frame:.3f} s a frame "
        f"(measured on {found.measured} videos)"
    )
