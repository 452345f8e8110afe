"""The batch itself: draw what waits, have it done, put packages in their place, record it.

This process alone moves packages and writes the ledger, so whatever is killed, the two agree:
a package is moved first, in one step, then recorded; what lies between is recorded at the next
start (`rebuilding`). Workers only make packages in the archive's work folder.
"""

from __future__ import annotations

import contextlib
import dataclasses
import secrets
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dance2pose.archive import packages
from dance2pose.archive.executors import Executor, LocalExecutor, run
from dance2pose.archive.jobs import (
    NOT_THE_ITEMS_FAULT,
    WORTH_ANOTHER_ATTEMPT,
    Failure,
    Job,
    Outcome,
)
from dance2pose.archive.layout import Archive
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.ledger_tables import Item
from dance2pose.archive.options import BatchOptions
from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.workers import Limits
from dance2pose.errors import OutputError
from dance2pose.output_files import is_disk_full, output_error
from dance2pose.progress import Progress

STAGE = "dance2pose.archive.worker:process_item"


@dataclass
class Tally:
    """What a run of the batch came to."""

    done: int = 0
    failed: int = 0


@dataclass(frozen=True)
class Batch:
    """One run over an archive whose ledger is open and whose lock is held."""

    archive: Archive
    ledger: Ledger
    recipe: Recipe
    options: BatchOptions
    quality: QualityLimits
    progress: Progress
    stage: str = STAGE

    def run(self, expected: int) -> Tally:
        """Do everything that waits. expected: how many items that is, for the display.

        Raises OutputError where the disk is full; what was in hand then waits again, as it does
        when the run is stopped.
        """
        tally = Tally()
        self.ledger.set_fact("session started", repr(time.time()))
        with contextlib.ExitStack() as stack:
            stack.callback(self._put_back)
            executor = stack.enter_context(executor_for(self.options))
            self.ledger.set_fact("session workers", str(max(1, executor.capacity // 2)))
            outcomes = self._outcomes(executor)
            for outcome in self.progress.track(outcomes, "videos", total=expected, unit="video"):
                self._settle(outcome, tally)
        return tally

    def _put_back(self) -> None:
        """Leave nothing marked as running. On a full disk the next start does it."""
        with contextlib.suppress(OutputError):
            self.ledger.put_back_running()

    def _outcomes(self, executor: Executor) -> Iterator[Outcome]:
        """Outcomes until nothing waits any more; items that failed come round again."""
        drawn = True
        while drawn:
            drawn = False
            for outcome in run(executor, self._jobs()):
                drawn = True
                yield outcome

    def _jobs(self) -> Iterator[Job]:
        place = 0
        while (found := self.ledger.draw(place)) is not None:
            place, item = found
            yield self._job(item)

    def _job(self, item: Item) -> Job:
        return Job(
            item=item.item,
            version=item.version + 1,
            source=item.path,
            sha256=item.sha256,
            fingerprint=item.fingerprint,
            recipe=self.recipe.with_row(item.overrides),
            quality=self.quality,
            archive=self.archive.identity(),
            work=self.archive.work,
            names=item.names,
            paths=item.paths,
            metadata=item.metadata,
            overrides=item.overrides,
            stage=self.stage,
        )

    def _settle(self, outcome: Outcome, tally: Tally) -> None:
        """Put the package in its place and record what came of the item."""
        if not outcome.failure:
            outcome = self._placed(outcome)
        if not outcome.failure:
            item = self.ledger.item(outcome.item)
            assert item is not None
            self.ledger.record_done(outcome, item.sha256)
            tally.done += 1
        elif outcome.failure in NOT_THE_ITEMS_FAULT:
            self.ledger.record_failure(outcome, again=True, counts=False)
            raise OutputError(
                f"{self.archive.path}: the disk is full; make room and give the same command again"
                f" ({outcome.error})"
            )
        else:
            self._record_failure(outcome, tally)

    def _record_failure(self, outcome: Outcome, tally: Tally) -> None:
        item = self.ledger.item(outcome.item)
        attempts = 1 + (item.attempts if item else 0)
        again = outcome.failure in WORTH_ANOTHER_ATTEMPT and attempts < self.options.attempts
        self.ledger.record_failure(outcome, again=again)
        tally.failed += not again
        next_step = "is tried again" if again else "counts as failed"
        self.progress.say(
            f"{outcome.item}: {packages.one_line(outcome.error)}; it {next_step} "
            f"(attempt {attempts})"
        )

    def _placed(self, outcome: Outcome) -> Outcome:
        """Move the package to its place. What the file system refuses becomes the outcome."""
        place = self.archive.package(outcome.item, outcome.version)
        try:
            packages.place(self._package(outcome), place)
        except OSError as error:
            failure: Failure = "disk full" if is_disk_full(error) else "internal"
            text = str(output_error(place, error))
            return dataclasses.replace(outcome, failure=failure, error=text)
        return outcome

    def _package(self, outcome: Outcome) -> Path:
        """The finished package on this disk, unpacked where it came through the network."""
        if outcome.package is not None:
            return outcome.package
        assert outcome.packed is not None
        folder = self.archive.work / f"{outcome.item}-{secrets.token_hex(4)}"
        try:
            folder.mkdir()
            packages.unpack(outcome.packed, folder)
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return folder


def executor_for(options: BatchOptions) -> Executor:
    """The executor that the options ask for."""
    limits = Limits(options.time_limit_min * 60, options.memory_limit_gb * 1e9)
    if options.cluster is None:
        return LocalExecutor(options.local_workers, limits)
    from dance2pose.archive.cluster import DaskExecutor

    return DaskExecutor(options.cluster, limits, options.needed_resources)
