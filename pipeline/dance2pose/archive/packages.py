"""One item, one package: a BagIt bag (RFC 8493) with SHA-256 manifests."""

from __future__ import annotations

import io
import json
import logging
import os
import shutil
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from dance2pose import __version__
from dance2pose.archive.jobs import Job
from dance2pose.errors import DataError
from dance2pose.file_hash import sha256_now

CARD = "item.json"
_SOFTWARE = f"dance2pose {__version__}"


def bag_info(job: Job) -> dict[str, str]:
    """What bag-info.txt says beside what is counted: what this is, from where, by what."""
    given = job.metadata[0] if job.metadata else {}
    info = {
        "Bagging-Date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "Bag-Software-Agent": _SOFTWARE,
        "External-Identifier": given.get("dc.identifier") or job.item,
        "Internal-Sender-Identifier": f"{job.item}/v{job.version}",
        "Internal-Sender-Description": f"3D motion of the dancers in {job.names[0]}"
        if job.names
        else "3D motion of the dancers in a video",
        "Source-SHA256": job.sha256,
    }
    if given.get("dc.title"):
        info["External-Description"] = given["dc.title"]
    if given.get("dc.creator"):
        info["Source-Creator"] = given["dc.creator"]
    if given.get("dc.rights"):
        info["Source-Rights"] = given["dc.rights"]
    return {name: one_line(value) for name, value in info.items()}


def one_line(text: str) -> str:
    """Text without line breaks and control characters, in bytes that UTF-8 has."""
    shown = text.encode("utf-8", "backslashreplace").decode()
    return " ".join("".join(c if c.isprintable() else " " for c in shown).split())


def write_card(folder: Path, job: Job, **known: Any) -> None:
    """Write item.json: what the ledger knows of this package, so that it can be made again."""
    card = {
        "form": 1,
        "item": job.item,
        "version": job.version,
        "sha256": job.sha256,
        "fingerprint": job.fingerprint,
        "overrides": job.overrides,
        "source": os.fsencode(job.source).hex(),
        "names": list(job.names),
        "paths": [os.fsencode(path).hex() for path in job.paths],
        "metadata": list(job.metadata),
        **known,
    }
    (folder / CARD).write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")


def make_bag(folder: Path, info: Mapping[str, str]) -> None:
    """Turn a folder of files into a bag, written through to the disk."""
    import bagit

    logging.getLogger("bagit").setLevel(logging.CRITICAL)
    bag = bagit.make_bag(str(folder), dict(info), checksums=["sha256"])
    # The library still writes the draft's 0.97; in these two files the forms are alike.
    declaration = "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n"
    (folder / "bagit.txt").write_text(declaration, encoding="utf-8")
    bag.save()
    for path in (*folder.rglob("*"), folder):
        sync(path)


def sync(path: Path) -> None:
    """Have a file or folder on the disk, not only in memory."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def place(package: Path, destination: Path) -> None:
    """Move a finished package where it belongs, at once. Raises OSError."""
    if destination.exists():
        raise FileExistsError(17, "a package is there already", str(destination))
    destination.parent.mkdir(exist_ok=True)
    package.rename(destination)
    sync(destination.parent)


def packed(package: Path) -> bytes:
    """A package as bytes, for the way back from a worker without a common disk."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(package.rglob("*")):
            if path.is_file():
                archive.write(path, path.relative_to(package).as_posix())
    return stream.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """The reverse of `packed`; names that lead out of the folder are refused."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for name in archive.namelist():
            target = (folder / name).resolve()
            if not target.is_relative_to(folder.resolve()):
                raise DataError(f"{name}: leads out of the package")
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(name) as source, target.open("wb") as copy:
                shutil.copyfileobj(source, copy)
                copy.flush()
                os.fsync(copy.fileno())


@dataclass(frozen=True)
class Card:
    """What item.json says."""

    item: str
    version: int
    sha256: str
    fingerprint: str
    source: Path
    overrides: dict[str, str]
    names: tuple[str, ...]
    paths: tuple[Path, ...]
    metadata: tuple[dict[str, str], ...]
    started: float
    seconds: float


def read_card(package: Path) -> Card:
    """The card of a package. Raises DataError naming what is wrong with it."""
    path = package / "data" / CARD
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
        return Card(
            item=str(card["item"]),
            version=int(card["version"]),
            sha256=str(card["sha256"]),
            fingerprint=str(card["fingerprint"]),
            source=_path(card["source"]),
            overrides={str(k): str(v) for k, v in card["overrides"].items()},
            names=tuple(map(str, card["names"])),
            paths=tuple(map(_path, card["paths"])),
            metadata=tuple({str(k): str(v) for k, v in row.items()} for row in card["metadata"]),
            started=float(card["started"]),
            seconds=float(card["seconds"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def _path(text: str) -> Path:
    return Path(os.fsdecode(bytes.fromhex(text)))


def read_quality(package: Path) -> dict[str, Any]:
    """quality.json of a package; empty where it cannot be read."""
    try:
        found = json.loads((package / "data" / "quality.json").read_text(encoding="utf-8"))
        return found if isinstance(found, dict) else {}
    except (OSError, ValueError):
        return {}


def problems(package: Path) -> list[str]:
    """What is damaged, missing or extra in a package, a line each; none for a whole one."""
    import bagit

    logging.getLogger("bagit").setLevel(logging.CRITICAL)
    try:
        bag = bagit.Bag(str(package))
        missing, extra = map(sorted, bag.compare_manifests_with_fs())
        found = [f"missing: {name}" for name in missing] + [f"extra: {name}" for name in extra]
        for name, hashes in sorted(bag.entries.items()):
            path = package / name
            if path.is_file():
                found += _damage(name, path, hashes)
        if not found:
            bag.validate(fast=True)
        return found
    except (bagit.BagError, OSError, UnicodeDecodeError) as error:
        return [one_line(str(error)) or type(error).__name__]


def _damage(name: str, path: Path, hashes: Mapping[str, str]) -> list[str]:
    try:
        is_now = sha256_now(path)
    except OSError as error:
        return [f"unreadable: {name}: {error.strerror}"]
    wanted = hashes.get("sha256", "").lower()
    return [] if is_now == wanted else [f"damaged: {name}: sha256 {is_now}, expected {wanted}"]
