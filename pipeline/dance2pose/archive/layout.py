"""Where things lie in an archive.

ARCHIVE/ledger.sqlite, ARCHIVE/packages/ITEM/v1 (a bag), ARCHIVE/work (packages that are being
made; swept at every start), ARCHIVE/report.html, ARCHIVE/archive.json (that this is an archive,
and which one).
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dance2pose.errors import DataError, OutputError, UsageError
from dance2pose.output_files import output_error

FORM = 1
_VERSION = re.compile(r"v([1-9][0-9]{0,5})")


@dataclass(frozen=True)
class Archive:
    """The places of one archive. `open_archive` and `create_archive` check that it is one."""

    path: Path

    @property
    def card(self) -> Path:
        return self.path / "archive.json"

    @property
    def ledger(self) -> Path:
        return self.path / "ledger.sqlite"

    @property
    def lock(self) -> Path:
        return self.path / "lock"

    @property
    def work(self) -> Path:
        return self.path / "work"

    @property
    def packages(self) -> Path:
        return self.path / "packages"

    @property
    def report(self) -> Path:
        return self.path / "report.html"

    def package(self, item: str, version: int) -> Path:
        return self.packages / item / f"v{version}"

    def found_packages(self) -> Iterator[tuple[str, int, Path]]:
        """(item, version, folder) of every package that is in its place."""
        if not self.packages.is_dir():
            return
        for item in sorted(os.scandir(self.packages), key=lambda entry: entry.name):
            if item.is_dir(follow_symlinks=False):
                for entry in os.scandir(item):
                    version = _VERSION.fullmatch(entry.name)
                    if version and entry.is_dir(follow_symlinks=False):
                        yield item.name, int(version[1]), Path(entry.path)

    def identity(self) -> str:
        """The archive's own random name, by which a cluster's worker knows that it sees it."""
        try:
            card = json.loads(self.card.read_text(encoding="utf-8"))
            if card["form"] != FORM:
                raise DataError(
                    f"{self.card}: an archive of form {card['form']}, expected form {FORM}"
                )
            return str(card["archive"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DataError(f"{self.card}: cannot be read: {error}") from error


def open_archive(path: Path) -> Archive:
    """An archive that exists. Raises UsageError for a folder that is none."""
    archive = Archive(path.resolve())
    if not archive.card.is_file():
        raise UsageError(
            f"{path}: not an archive (no archive.json in it); `dance2pose batch` makes one"
        )
    archive.identity()
    return archive


def create_archive(path: Path) -> Archive:
    """The archive at a path, made if there is nothing yet. UsageError if something else is."""
    archive = Archive(path.resolve())
    if archive.card.exists():
        return open_archive(path)
    if path.exists() and (not path.is_dir() or _foreign(path)):
        raise UsageError(f"{path}: exists and is not an archive; give another name or empty it")
    try:
        archive.path.mkdir(parents=True, exist_ok=True)
        for folder in (archive.work, archive.packages):
            folder.mkdir(exist_ok=True)
        card = {"form": FORM, "archive": secrets.token_hex(8), "made by": "dance2pose batch"}
        part = archive.card.with_suffix(".part")
        part.write_text(json.dumps(card) + "\n", encoding="utf-8")
        part.replace(archive.card)
    except OSError as error:
        raise output_error(path, error) from error
    return archive


def _foreign(path: Path) -> bool:
    """Whether a folder holds what a beginning archive does not."""
    ours = {"work", "packages", "archive.part", "lock"}
    return any(entry.name not in ours for entry in path.iterdir())


@contextlib.contextmanager
def locked(archive: Archive) -> Iterator[None]:
    """Hold the archive alone. The lock goes with the process, however that ends.

    Raises OutputError, naming who holds it, where another process does.
    """
    import fcntl

    try:
        file = archive.lock.open("a+", encoding="utf-8")
    except OSError as error:
        raise output_error(archive.lock, error) from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            holder = file.read(200).strip() or "another process"
            raise OutputError(
                f"{archive.path}: is being written by {holder}; wait for it or stop it first"
            ) from error
        file.seek(0)
        file.truncate()
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        yield


def sweep(archive: Archive) -> None:
    """Remove half-made packages. Only for who holds the lock, while no worker of its own runs."""
    for folder in (archive.work, archive.packages):
        folder.mkdir(exist_ok=True)
    for entry in os.scandir(archive.work):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path, ignore_errors=True)
        else:
            Path(entry.path).unlink(missing_ok=True)
