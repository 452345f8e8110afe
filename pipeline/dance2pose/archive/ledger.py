"""The ledger of an archive: one SQLite file with every item, name, package and attempt.

One process writes (the one that holds the archive's lock); any number may read. What is in it can
be made again from the packages (`rebuilding`).
"""

from __future__ import annotations

import contextlib
import os
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from dance2pose.archive.jobs import Outcome
from dance2pose.archive.ledger_tables import (
    FORM,
    TABLES,
    Item,
    State,
    finite,
    item_of,
    json_text,
    key_of,
)
from dance2pose.errors import DataError, OutputError

_ITEM = (
    "SELECT i.*, coalesce((SELECT max(version) FROM packages p WHERE p.item = i.item), 0)"
    " AS version FROM items i"
)


class Ledger:
    """The open ledger. Raises DataError where the file is not one, OutputError for a full disk."""

    def __init__(self, path: Path | str, *, read_only: bool = False) -> None:
        self.path = path
        with self._errors():
            self._db = sqlite3.connect(path, timeout=30.0, isolation_level=None)
            self._db.row_factory = sqlite3.Row
            if read_only:
                self._db.execute("PRAGMA query_only = ON")
            else:
                self._db.execute("PRAGMA journal_mode = WAL")
                self._db.execute("PRAGMA synchronous = NORMAL")
                self._db.executescript(TABLES)
            self._check_form(read_only)

    def _check_form(self, read_only: bool) -> None:
        form = self.fact("form")
        if form is None and not read_only:
            self.set_fact("form", str(FORM))
        elif form != str(FORM):
            raise DataError(f"{self.path}: a ledger of form {form}, this program knows form {FORM}")

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            if "disk is full" in str(error) or "disk I/O" in str(error):
                raise OutputError(f"{self.path}: cannot be written: {error}") from error
            raise DataError(f"{self.path}: not a whole ledger: {error}") from error

    @contextlib.contextmanager
    def transaction(self) -> Iterator[None]:
        """All that is written in the block, or nothing of it."""
        with self._errors():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")

    def _run(self, sql: str, *values: Any) -> sqlite3.Cursor:
        with self._errors():
            return self._db.execute(sql, values)

    def close(self) -> None:
        self._db.close()

    def copy_from(self, path: Path) -> None:
        """Take over the content of another ledger (a dry run works on a copy in memory)."""
        with self._errors(), contextlib.closing(sqlite3.connect(path)) as other:
            other.backup(self._db)

    # Facts about the archive as a whole.

    def fact(self, name: str) -> str | None:
        row = self._run("SELECT value FROM facts WHERE name = ?", name).fetchone()
        return None if row is None else str(row["value"])

    def set_fact(self, name: str, value: str) -> None:
        self._run("INSERT OR REPLACE INTO facts VALUES (?, ?)", name, value)

    # Hashes of sources, so that a file that has not changed is read once in its life.

    def known_hash(self, path: Path, status: os.stat_result) -> str | None:
        row = self._run(
            "SELECT sha256 FROM hashes WHERE path = ? AND size = ? AND changed_ns = ?",
            os.fsencode(path),
            status.st_size,
            status.st_mtime_ns,
        ).fetchone()
        return None if row is None else str(row["sha256"])

    def keep_hash(self, path: Path, status: os.stat_result, sha256: str) -> None:
        self._run(
            "INSERT OR REPLACE INTO hashes VALUES (?, ?, ?, ?)",
            os.fsencode(path),
            status.st_size,
            status.st_mtime_ns,
            sha256,
        )

    # Items and their names.

    def item(self, item: str) -> Item | None:
        row = self._run(f"{_ITEM} WHERE i.item = ?", item).fetchone()
        return None if row is None else self._item(row)

    def items(self, *states: State) -> Iterator[Item]:
        marks = ",".join("?" * len(states))
        where = f" WHERE i.state IN ({marks})" if states else ""
        names = self._all_names()
        for row in self._run(f"{_ITEM}{where} ORDER BY i.rowid", *states):
            yield self._item(row, names.get(row["item"], []))

    def by_content(self, sha256: str, overrides: dict[str, str]) -> Item | None:
        row = self._run(
            f"{_ITEM} WHERE i.sha256 = ? AND i.overrides = ?", sha256, key_of(overrides)
        ).fetchone()
        return None if row is None else self._item(row)

    def by_name(self, path: Path, overrides: dict[str, str]) -> Item | None:
        """The item that was last found under this name, if it is found under no name now."""
        row = self._run(
            f"{_ITEM} JOIN names n ON n.item = i.item WHERE n.path = ? AND n.overrides = ?"
            " AND NOT EXISTS (SELECT 1 FROM names m WHERE m.item = i.item AND m.present)",
            os.fsencode(path),
            key_of(overrides),
        ).fetchone()
        return None if row is None else self._item(row)

    def add_item(self, item: str, sha256: str, overrides: dict[str, str], path: Path) -> None:
        self._run(
            "INSERT INTO items (item, sha256, overrides, path, state, fingerprint)"
            " VALUES (?, ?, ?, ?, 'waiting', '')",
            item,
            sha256,
            key_of(overrides),
            os.fsencode(path),
        )

    def set_source(self, item: str, sha256: str, path: Path) -> None:
        self._run(
            "UPDATE items SET sha256 = ?, path = ? WHERE item = ?", sha256, os.fsencode(path), item
        )

    def forget_presence(self) -> None:
        """Before a new look at the source: what is not found then is not drawn."""
        self._run("UPDATE names SET present = 0")

    def set_name(
        self, path: Path, overrides: dict[str, str], item: str, name: str, metadata: dict[str, str]
    ) -> None:
        self._run(
            "INSERT OR REPLACE INTO names VALUES (?, ?, ?, ?, ?, 1)",
            os.fsencode(path),
            key_of(overrides),
            item,
            name,
            json_text(metadata),
        )

    def _all_names(self) -> dict[str, list[sqlite3.Row]]:
        names: dict[str, list[sqlite3.Row]] = {}
        for row in self._run("SELECT item, path, name, metadata FROM names ORDER BY rowid"):
            names.setdefault(row["item"], []).append(row)
        return names

    def _item(self, row: sqlite3.Row, names: Sequence[sqlite3.Row] | None = None) -> Item:
        if names is None:
            names = self._run(
                "SELECT path, name, metadata FROM names WHERE item = ? ORDER BY rowid", row["item"]
            ).fetchall()
        return item_of(row, names)

    # How items go from state to state.

    def set_waiting(self, item: str, fingerprint: str) -> None:
        self._run(
            "UPDATE items SET state = 'waiting', fingerprint = ?, attempts = 0, failure = '',"
            " error = '' WHERE item = ?",
            fingerprint,
            item,
        )

    def set_failed(self, item: str, fingerprint: str, failure: str, error: str) -> None:
        """An item that is known to fail without an attempt."""
        self._run(
            "UPDATE items SET state = 'failed', fingerprint = ?, failure = ?, error = ?,"
            " finished = ? WHERE item = ?",
            fingerprint,
            failure,
            error,
            time.time(),
            item,
        )

    def draw(self, after: int) -> tuple[int, Item] | None:
        """The next waiting item after a row number, now running; its row number with it."""
        row = self._run(
            "SELECT i.rowid AS place, i.item FROM items i WHERE i.state = 'waiting' AND"
            " i.rowid > ? AND EXISTS (SELECT 1 FROM names n WHERE n.item = i.item AND n.present)"
            " ORDER BY i.rowid LIMIT 1",
            after,
        ).fetchone()
        if row is None:
            return None
        self._run(
            "UPDATE items SET state = 'running', started = ? WHERE item = ?",
            time.time(),
            row["item"],
        )
        item = self.item(row["item"])
        assert item is not None
        return row["place"], item

    def put_back_running(self) -> int:
        """What a run that was interrupted left as running waits again; no attempt is counted."""
        return self._run("UPDATE items SET state = 'waiting' WHERE state = 'running'").rowcount

    def put_back_failed(self) -> int:
        """Every failed item waits again, with all its attempts before it."""
        return self._run(
            "UPDATE items SET state = 'waiting', attempts = 0 WHERE state = 'failed'"
        ).rowcount

    def record_done(self, outcome: Outcome, sha256: str) -> None:
        """The package of an item is in its place."""
        now = time.time()
        with self.transaction():
            self._record_attempt(outcome, now)
            self._run(
                "INSERT INTO packages VALUES (?, ?, ?, ?, ?)",
                outcome.item,
                outcome.version,
                outcome.fingerprint,
                sha256,
                now,
            )
            self._run(
                "UPDATE items SET state = 'done', fingerprint = ?, attempts = attempts + 1,"
                " failure = '', error = '', started = ?, finished = ?, seconds = ?, quality = ?"
                " WHERE item = ?",
                outcome.fingerprint,
                outcome.started,
                now,
                outcome.seconds,
                json_text({name: finite(value) for name, value in outcome.quality.items()}),
                outcome.item,
            )

    def record_failure(self, outcome: Outcome, *, again: bool, counts: bool = True) -> None:
        """An attempt that came to nothing. again: the item waits for another."""
        now = time.time()
        with self.transaction():
            if counts:
                self._record_attempt(outcome, now)
            self._run(
                "UPDATE items SET state = ?, attempts = attempts + ?, failure = ?, error = ?,"
                " finished = ?, seconds = ? WHERE item = ?",
                "waiting" if again else "failed",
                int(counts),
                outcome.failure,
                outcome.error,
                now,
                outcome.seconds,
                outcome.item,
            )

    def _record_attempt(self, outcome: Outcome, ended: float) -> None:
        self._run(
            "INSERT INTO attempts VALUES (?, ?, ?, ?, ?, ?, ?)",
            outcome.item,
            outcome.version,
            outcome.started,
            ended,
            outcome.failure,
            outcome.error,
            outcome.worker,
        )

    def packages(self) -> list[tuple[str, int, str]]:
        """(item, version, fingerprint) of every package that was recorded."""
        rows = self._run("SELECT item, version, fingerprint FROM packages ORDER BY item, version")
        return [(row["item"], row["version"], row["fingerprint"]) for row in rows]

    # Sums over everything, for `status`.

    def counts(self) -> dict[str, int]:
        rows = self._run("SELECT state, count(*) AS n FROM items GROUP BY state")
        return {row["state"]: row["n"] for row in rows}

    def failures(self) -> list[tuple[str, str, int]]:
        """(kind, an example, how many) of the failed items, the most frequent kind first."""
        rows = self._run(
            "SELECT failure, min(error) AS example, count(*) AS n FROM items"
            " WHERE state = 'failed' GROUP BY failure ORDER BY n DESC"
        )
        return [(row["failure"], row["example"], row["n"]) for row in rows]

    def verdicts(self) -> dict[str, int]:
        rows = self._run(
            "SELECT json_extract(quality, '$.verdict') AS verdict, count(*) AS n FROM items"
            " WHERE state = 'done' GROUP BY verdict"
        )
        return {row["verdict"] or "unknown": row["n"] for row in rows}

    def finished_since(self, moment: float) -> tuple[int, float | None]:
        """How many items were done since a moment, and when the last one was."""
        row = self._run(
            "SELECT count(*) AS n, max(finished) AS last FROM items"
            " WHERE state = 'done' AND finished >= ?",
            moment,
        ).fetchone()
        return row["n"], row["last"]
