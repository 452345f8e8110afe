"""Fixity and completeness of every package of an archive, and of the ledger against them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass

from dance2pose.archive import packages
from dance2pose.archive.layout import Archive
from dance2pose.archive.ledger import Ledger
from dance2pose.progress import Progress


@dataclass(frozen=True)
class Verified:
    """packages: how many were looked at. problems: (package, what is wrong), one a problem."""

    packages: int
    problems: tuple[tuple[str, str], ...]


def verify(archive: Archive, progress: Progress, *, threads: int | None = None) -> Verified:
    """Look at every file of every package, several packages at a time. Changes nothing."""
    found = list(archive.found_packages())
    problems: list[tuple[str, str]] = []
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        results = pool.map(packages.problems, (folder for _, _, folder in found))
        shown = progress.track(results, "verifying", total=len(found), unit="package")
        for (item, version, _), wrong in zip(found, shown, strict=True):
            problems += [(f"{item}/v{version}", problem) for problem in wrong]
    problems += _against_ledger(archive, {(item, version) for item, version, _ in found})
    return Verified(len(found), tuple(problems))


def _against_ledger(archive: Archive, found: set[tuple[str, int]]) -> Iterator[tuple[str, str]]:
    """Packages that the ledger tells of and are not there, and the reverse."""
    if not archive.ledger.exists():
        yield "ledger", "is missing; the next `dance2pose batch` makes it again from the packages"
        return
    with closing(Ledger(archive.ledger, read_only=True)) as ledger:
        recorded = {(item, version) for item, version, _ in ledger.packages()}
    for item, version in sorted(recorded - found):
        yield f"{item}/v{version}", "missing: the ledger has it, the folder is not there"
    for item, version in sorted(found - recorded):
        yield f"{item}/v{version}", "not in the ledger yet; the next `dance2pose batch` records it"
