"""`dance2pose batch` as a function: a source and an archive in, packages and a ledger out."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from dance2pose.archive.batch import STAGE, Batch, Tally
from dance2pose.archive.fingerprints import model_files
from dance2pose.archive.layout import Archive, create_archive, locked, open_archive, sweep
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.options import BatchOptions
from dance2pose.archive.planning import Plan, Planner, recipe_of
from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.rebuilding import open_ledger
from dance2pose.archive.recipe import COLUMNS, Recipe
from dance2pose.archive.sources import Entry, find_entries
from dance2pose.errors import UsageError
from dance2pose.progress import Progress, Silent


@dataclass(frozen=True)
class BatchResult:
    """What a batch found to do and what it came to."""

    plan: Plan
    tally: Tally
    failed_in_all: int


def run_batch(
    source: Path,
    archive: Path,
    recipe: Recipe,
    *,
    options: BatchOptions | None = None,
    quality: QualityLimits | None = None,
    progress: Progress | None = None,
    stage: str = STAGE,
) -> BatchResult:
    """Bring an archive up to what a source holds; the same again goes on where it stopped.

    Raises UsageError for what is wrong with the request, before any work; OutputError where
    another batch has the archive, or the disk is full.
    """
    progress = progress or Silent()
    entries = entries_of(source, archive, recipe)
    if stage == STAGE:
        from dance2pose.people import load_models

        load_models(recipe.settings)  # what is the matter with them is found now, not in every item
    place = create_archive(archive)
    with locked(place):
        sweep(place)
        with contextlib.closing(open_ledger(place, progress)) as ledger:
            plan = Planner(ledger, recipe, progress).planned(entries)
            for line in plan.lines():
                progress.say(line)
            batch = Batch(
                place,
                ledger,
                recipe,
                options or BatchOptions(),
                quality or QualityLimits(),
                progress,
                stage,
            )
            tally = batch.run(plan.to_do) if plan.to_do else Tally()
            # Workers of a batch that was killed may have gone on for a moment after the first one.
            sweep(place)
            return BatchResult(plan, tally, ledger.counts().get("failed", 0))


def entries_of(source: Path, archive: Path, recipe: Recipe) -> list[Entry]:
    """The videos of a source; UsageError where there are none or a row or a model is wrong."""
    model_files(recipe)
    entries = find_entries(source, settings=COLUMNS, leave_out=archive)
    if not entries:
        raise UsageError(f"{source}: holds no file with the name of a video")
    for entry in entries:
        recipe_of(entry, recipe)
    return entries


def look_only(source: Path, archive: Path, recipe: Recipe, progress: Progress) -> Ledger:
    """What a batch would find, in a ledger in memory; nothing is written anywhere."""
    entries = entries_of(source, archive, recipe)
    ledger = Ledger(":memory:")
    if Archive(archive).card.is_file():
        existing = open_archive(archive).ledger
        if existing.exists():
            ledger.copy_from(existing)
    plan = Planner(ledger, recipe, progress).planned(entries)
    for line in plan.lines():
        progress.say(line)
    return ledger
