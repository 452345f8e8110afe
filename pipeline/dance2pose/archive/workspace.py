"""The folder in which a worker makes a package."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from dance2pose.archive.jobs import Job
from dance2pose.archive.layout import Archive
from dance2pose.errors import DataError


@contextlib.contextmanager
def workspace(job: Job) -> Iterator[tuple[Path, bool]]:
    """A new folder for the package, and whether it lies in the archive.

    A cluster's worker may not see the archive; then the folder is a temporary one, and goes at
    the end. Any failure removes it in either case.
    """
    seen = _sees_archive(job)
    folder = Path(tempfile.mkdtemp(prefix=f"{job.item}-", dir=job.work if seen else None))
    folder.chmod(0o755)
    try:
        yield folder, seen
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    if not seen:
        shutil.rmtree(folder, ignore_errors=True)


def _sees_archive(job: Job) -> bool:
    try:
        return Archive(job.work.parent).identity() == job.archive
    except DataError:
        return False
