"""What stands in a ledger: its tables, and an item as it is read from them."""

from __future__ import annotations

import json
import math
import os
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

State = Literal["waiting", "running", "done", "failed"]
FORM = 1

TABLES = """
CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS items (
    item TEXT PRIMARY KEY, sha256 TEXT NOT NULL, overrides TEXT NOT NULL, path BLOB NOT NULL,
    state TEXT NOT NULL, fingerprint TEXT NOT NULL, attempts INTEGER NOT NULL DEFAULT 0,
    failure TEXT NOT NULL DEFAULT '', error TEXT NOT NULL DEFAULT '',
    started REAL, finished REAL, seconds REAL, quality TEXT NOT NULL DEFAULT '{}');
CREATE INDEX IF NOT EXISTS items_by_state ON items (state);
CREATE INDEX IF NOT EXISTS items_by_content ON items (sha256, overrides);
CREATE TABLE IF NOT EXISTS names (
    path BLOB NOT NULL, overrides TEXT NOT NULL, item TEXT NOT NULL, name TEXT NOT NULL,
    metadata TEXT NOT NULL, present INTEGER NOT NULL, PRIMARY KEY (path, overrides));
CREATE INDEX IF NOT EXISTS names_by_item ON names (item);
CREATE TABLE IF NOT EXISTS packages (
    item TEXT NOT NULL, version INTEGER NOT NULL, fingerprint TEXT NOT NULL, sha256 TEXT NOT NULL,
    made REAL NOT NULL, PRIMARY KEY (item, version));
CREATE TABLE IF NOT EXISTS attempts (
    item TEXT NOT NULL, version INTEGER NOT NULL, started REAL, ended REAL NOT NULL,
    failure TEXT NOT NULL, error TEXT NOT NULL, worker TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS hashes (
    path BLOB PRIMARY KEY, size INTEGER NOT NULL, changed_ns INTEGER NOT NULL,
    sha256 TEXT NOT NULL);
"""


@dataclass(frozen=True)
class Item:
    """What the ledger knows of one video. version: of the newest package, 0 where there is none."""

    item: str
    sha256: str
    overrides: dict[str, str]
    path: Path
    state: State
    fingerprint: str
    attempts: int = 0
    failure: str = ""
    error: str = ""
    started: float | None = None
    finished: float | None = None
    seconds: float | None = None
    quality: dict[str, Any] = field(default_factory=dict)
    version: int = 0
    names: tuple[str, ...] = ()
    paths: tuple[Path, ...] = ()
    metadata: tuple[dict[str, str], ...] = ()


def item_of(row: sqlite3.Row, names: Sequence[sqlite3.Row]) -> Item:
    """An item from its row of `items` (with its newest version) and its rows of `names`."""
    return Item(
        item=row["item"],
        sha256=row["sha256"],
        overrides=json.loads(row["overrides"]),
        path=Path(os.fsdecode(row["path"])),
        state=row["state"],
        fingerprint=row["fingerprint"],
        attempts=row["attempts"],
        failure=row["failure"],
        error=row["error"],
        started=row["started"],
        finished=row["finished"],
        seconds=row["seconds"],
        quality=json.loads(row["quality"]),
        version=row["version"],
        names=tuple(name["name"] for name in names),
        paths=tuple(Path(os.fsdecode(name["path"])) for name in names),
        metadata=tuple(json.loads(name["metadata"]) for name in names),
    )


def json_text(value: Any) -> str:
    return json.dumps(value)  # ASCII: a name may hold what UTF-8 has no bytes for


def finite(value: Any) -> Any:
    """SQLite's JSON knows no infinity and no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def key_of(overrides: dict[str, str]) -> str:
    return json.dumps(overrides, sort_keys=True)
