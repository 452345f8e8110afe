"""Writing result files so that they are complete or absent, never half-written."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from dance2pose.errors import OutputError, OutputExistsError
from dance2pose.leftovers import sweep_once, temporary_name

_FULL = (errno.ENOSPC, errno.EDQUOT)


def check_output(path: Path, *, overwrite: bool) -> None:
    """Raise OutputError unless `path` can be written, before any work is spent on it.

    What killed runs left in its folder is removed on the way.
    """
    folder = path.parent
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if path.is_dir():
        raise OutputError(f"{path}: is a folder, expected the name of a file to write")
    if path.exists() and not overwrite:
        raise OutputExistsError(f"{path}: exists already; give --overwrite or another name with -o")
    sweep_once(folder)
    probe = temporary_name(path)
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise output_error(path, error) from error


@contextlib.contextmanager
def written_whole(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Give a temporary name beside `path`; rename it to `path` when the block ends well.

    The temporary file is removed on any error, Ctrl-C included. Raises OutputError for what
    the file system refuses (folder missing, read-only, disk full, file exists).
    """
    check_output(path, overwrite=overwrite)
    temporary = temporary_name(path)
    try:
        yield temporary
        if path.exists() and not overwrite:
            raise OutputExistsError(f"{path}: appeared while it was being written; not overwritten")
        with temporary.open("r+b") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    except OSError as error:
        raise output_error(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def output_error(path: Path, error: OSError) -> OutputError:
    """What the file system refused, for the person who asked for `path`."""
    if error.errno in _FULL:
        return OutputError(f"{path}: cannot be written, the disk is full; nothing was left behind")
    return OutputError(f"{path}: cannot be written: {error.strerror or error}")


def is_disk_full(error: BaseException) -> bool:
    """Whether a full disk is what an error, or one that led to it, comes from."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, OSError) and seen.errno in _FULL:
            return True
        seen = seen.__cause__ or seen.__context__
    return False
