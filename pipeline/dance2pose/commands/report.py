"""`dance2pose report`: a page to look through an archive."""

from __future__ import annotations

import contextlib
from pathlib import Path


def report(archive: Path, *, quiet: bool = False) -> None:
    """Write report.html into an archive: what there is, what to look at, what failed and why.

    Parameters
    ----------
    archive
        The folder that `dance2pose batch` writes to; it may be running.
    quiet
        Do not say where the page is.
    """
    from dance2pose.archive.layout import open_archive
    from dance2pose.archive.ledger import Ledger
    from dance2pose.archive.report import write_report

    place = open_archive(archive)
    with contextlib.closing(Ledger(place.ledger, read_only=True)) as ledger:
        page = write_report(place, ledger)
    if not quiet:
        print(f"wrote {page}")
