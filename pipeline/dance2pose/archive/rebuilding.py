"""The ledger and the packages brought together: after a crash, and when the ledger is lost."""

from __future__ import annotations

import time
from pathlib import Path

from dance2pose.archive import packages
from dance2pose.archive.jobs import Outcome
from dance2pose.archive.layout import Archive
from dance2pose.archive.ledger import Ledger
from dance2pose.errors import DataError
from dance2pose.progress import Progress


def open_ledger(archive: Archive, progress: Progress) -> Ledger:
    """The archive's ledger, true to the packages. For the one who holds the archive's lock.

    A ledger that is damaged is put aside, and one that is not there is made from the packages.
    """
    fresh = not archive.ledger.exists()
    try:
        ledger = Ledger(archive.ledger)
        ledger.counts()
    except DataError as error:
        aside = archive.ledger.with_name(f"ledger.damaged-{time.time_ns()}.sqlite")
        progress.say(f"{error}; it is kept as {aside.name} and made again from the packages")
        for suffix in ("", "-wal", "-shm"):
            part = archive.ledger.with_name(archive.ledger.name + suffix)
            if part.exists():
                part.rename(aside.with_name(aside.name + suffix))
        fresh, ledger = True, Ledger(archive.ledger)
    ledger.put_back_running()
    recorded = record_unrecorded(archive, ledger, progress)
    if fresh and recorded:
        progress.say(f"the ledger was made again from {recorded} packages")
    return ledger


def record_unrecorded(archive: Archive, ledger: Ledger, progress: Progress) -> int:
    """Record the packages that are in their place and not in the ledger; how many there were.

    A package is moved to its place in one step when it is finished, and recorded then. Between
    the two a run can be killed; and all are unrecorded where the ledger is lost.
    """
    known = {(item, version) for item, version, _ in ledger.packages()}
    recorded = 0
    for item, version, folder in sorted(archive.found_packages()):
        if (item, version) in known:
            continue
        try:
            _record(ledger, folder, item, version)
            recorded += 1
        except DataError as error:
            progress.say(f"{error}; this package is left alone and its item done again")
    return recorded


def _record(ledger: Ledger, folder: Path, item: str, version: int) -> None:
    card = packages.read_card(folder)
    if (card.item, card.version) != (item, version):
        raise DataError(f"{folder}: says that it is {card.item}/v{card.version}")
    if ledger.item(item) is None:
        ledger.add_item(item, card.sha256, card.overrides, card.source)
        for path, name, metadata in zip(card.paths, card.names, card.metadata, strict=False):
            ledger.set_name(path, card.overrides, item, name, metadata)
    outcome = Outcome(
        item,
        version,
        card.fingerprint,
        quality=packages.read_quality(folder),
        seconds=card.seconds,
        started=card.started,
        worker="found in its place",
    )
    ledger.record_done(outcome, card.sha256)
