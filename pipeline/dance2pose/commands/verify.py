"""`dance2pose verify`: whether every package of an archive is whole."""

from __future__ import annotations

from pathlib import Path

from dance2pose.errors import DataError
from dance2pose.progress import for_terminal


def verify(archive: Path, *, quiet: bool = False) -> None:
    """Check fixity and completeness of every package of an archive.

    Every file is read and compared with its SHA-256, and the ledger with the folders. Says what
    is damaged, missing or extra, one line each; the exit status is 0 only where nothing is.

    Parameters
    ----------
    archive
        The folder that `dance2pose batch` writes to.
    quiet
        Show no progress; problems are still printed.
    """
    from dance2pose.archive.layout import open_archive
    from dance2pose.archive.verifying import verify as run

    found = run(open_archive(archive), for_terminal(quiet=quiet))
    for package, problem in found.problems:
        print(f"{package}: {problem}")
    if found.problems:
        raise DataError(f"{archive}: {len(found.problems)} problems in {found.packages} packages")
    if not quiet:
        print(f"{found.packages} packages are whole")
