"""The SHA-256 of files: what a result was made from is named by it."""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path

from dance2pose.errors import DataError


def file_sha256(path: Path) -> str:
    """SHA-256 of a file in hex, read once while the file stays as it is."""
    try:
        status = path.stat()
        return _sha256(path, status.st_size, status.st_mtime_ns)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error


@lru_cache(maxsize=16)
def _sha256(path: Path, size: int, changed_ns: int) -> str:
    del size, changed_ns  # a changed file is another entry of the cache
    return sha256_now(path)


def sha256_now(path: Path) -> str:
    """SHA-256 of a file in hex, read anew. Raises OSError; never waits, as a pipe would make it."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
