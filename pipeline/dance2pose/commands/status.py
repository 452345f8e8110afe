"""`dance2pose status`: how far an archive has come."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter


def status(
    archive: Path,
    *,
    as_json: Annotated[bool, Parameter(name="--json")] = False,
    retry: Literal["failed"] | None = None,
) -> None:
    """Show how far an archive has come: counts, rate, time left, failures by reason.

    Parameters
    ----------
    archive
        The folder that `dance2pose batch` writes to.
    as_json
        Print one JSON object instead of lines.
    retry
        failed: let every failed item wait again; the next `dance2pose batch` tries them.
    """
    from dance2pose.archive.layout import locked, open_archive
    from dance2pose.archive.ledger import Ledger
    from dance2pose.archive.status import read_status

    place = open_archive(archive)
    if retry:
        with locked(place), contextlib.closing(Ledger(place.ledger)) as ledger:
            print(f"{ledger.put_back_failed()} failed items wait again")
    with contextlib.closing(Ledger(place.ledger, read_only=True)) as ledger:
        found = read_status(ledger)
    print(json.dumps(found.to_json(), indent=1) if as_json else "\n".join(found.lines()))
