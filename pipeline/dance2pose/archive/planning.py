"""What a batch has to do: the source's videos against what the ledger knows."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dance2pose.archive.fingerprints import Fingerprints
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.ledger_tables import Item
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.sources import Entry, why_unreadable
from dance2pose.errors import UsageError
from dance2pose.file_hash import sha256_now
from dance2pose.progress import Progress

_HASHES_AT_ONCE = 20


@dataclass
class Plan:
    """How many videos (items) a look at the source found in which state."""

    names: int = 0
    new: int = 0
    changed: int = 0
    waiting: int = 0
    done: int = 0
    failed: int = 0

    @property
    def to_do(self) -> int:
        return self.new + self.changed + self.waiting

    def lines(self) -> list[str]:
        items = self.to_do + self.done + self.failed
        doubles = self.names - items
        found = f"{self.names} names found" if doubles else f"{items} videos found"
        if doubles:
            found += f", {doubles} of them for content that has another name too: {items} videos"
        return [
            f"{found}; to do {self.to_do} ({self.new} new, {self.changed} changed since they were "
            f"done, {self.waiting} left from before), done {self.done}, failed {self.failed}"
        ]


def recipe_of(entry: Entry, recipe: Recipe) -> Recipe:
    """The recipe with an entry's own settings. Raises UsageError that names the entry."""
    try:
        return recipe.with_row(entry.overrides)
    except UsageError as error:
        raise UsageError(f"{entry.name}: {error}") from error


class Planner:
    """Brings the ledger up to what the source holds now."""

    def __init__(self, ledger: Ledger, recipe: Recipe, progress: Progress) -> None:
        self._ledger = ledger
        self._recipe = recipe
        self._progress = progress
        self._fingerprints = Fingerprints()
        self._seen: set[str] = set()
        self._known: dict[tuple[Path, tuple[tuple[str, str], ...]], bool] = {}
        self.plan = Plan()

    def planned(self, entries: Sequence[Entry]) -> Plan:
        """Enter every video, each content once, and decide which are to be done.

        Raises UsageError for a row whose settings are wrong, before anything is changed.
        """
        recipes = [recipe_of(entry, self._recipe) for entry in entries]
        with self._ledger.transaction():
            self._ledger.forget_presence()
        hashes = self._hashes(entries)
        with self._ledger.transaction():
            found = list(zip(entries, recipes, hashes, strict=True))
            # First what has not changed: only then is it known which names have lost their item.
            for known in (True, False):
                for entry, recipe, sha256 in found:
                    if self._is_known(entry, sha256) is known:
                        self._enter(entry, recipe, sha256)
        self.plan.names = len(entries)
        return self.plan

    def _is_known(self, entry: Entry, sha256: str | Exception) -> bool:
        place = (entry.path, tuple(entry.overrides.items()))
        if place not in self._known:
            content = not isinstance(sha256, Exception)
            found = content and self._ledger.by_content(str(sha256), entry.overrides)
            self._known[place] = bool(found)
        return self._known[place]

    def _hashes(self, entries: Sequence[Entry]) -> list[str | Exception]:
        """SHA-256 of every video, read only where the ledger does not know it, or the failure."""
        found: list[str | Exception] = []
        known: list[tuple[Path, os.stat_result, str]] = []
        shown = self._progress.track(
            entries, "reading the videos", total=len(entries), unit="video"
        )
        for entry in shown:
            found.append(self._hash(entry.path, known))
            if len(known) >= _HASHES_AT_ONCE:
                self._keep(known)
        self._keep(known)
        return found

    def _hash(self, path: Path, known: list[tuple[Path, os.stat_result, str]]) -> str | Exception:
        problem = why_unreadable(path)
        if problem:
            return OSError(problem)
        try:
            status = path.stat()
            sha256 = self._ledger.known_hash(path, status)
            if sha256 is None:
                sha256 = sha256_now(path)
                known.append((path, status, sha256))
            return sha256
        except OSError as error:
            return OSError(f"cannot be read: {error.strerror or error}")

    def _keep(self, known: list[tuple[Path, os.stat_result, str]]) -> None:
        with self._ledger.transaction():
            for path, status, sha256 in known:
                self._ledger.keep_hash(path, status, sha256)
        known.clear()

    def _enter(self, entry: Entry, recipe: Recipe, sha256: str | Exception) -> None:
        path = entry.path.absolute()
        content = "" if isinstance(sha256, Exception) else sha256
        item = self._item(path, entry, content)
        self._ledger.set_name(path, entry.overrides, item.item, entry.name, entry.metadata)
        if item.item in self._seen:
            return
        self._seen.add(item.item)
        if isinstance(sha256, Exception):
            self._unreadable(item, f"{entry.name}: {sha256}")
            return
        self._ledger.set_source(item.item, content, path)
        self._decide(item, self._fingerprints.of(content, recipe))

    def _unreadable(self, item: Item, problem: str) -> None:
        """A video that is there and cannot be read; what was made of it before stays as it is."""
        if item.version:
            self._progress.say(f"{problem}; its package was made before and stays")
            self.plan.done += 1
        else:
            self._ledger.set_failed(item.item, "", "input", problem)
            self.plan.failed += 1

    def _decide(self, item: Item, fingerprint: str) -> None:
        """Whether an item is to be done, and that it is counted so."""
        if item.fingerprint == fingerprint and item.state == "done":
            self.plan.done += 1
        elif item.fingerprint == fingerprint and item.state == "failed":
            self.plan.failed += 1
        elif item.fingerprint == fingerprint:
            self.plan.waiting += 1
        else:
            self._ledger.set_waiting(item.item, fingerprint)
            if item.version:
                self.plan.changed += 1
            else:
                self.plan.new += 1

    def _item(self, path: Path, entry: Entry, content: str) -> Item:
        """The item of this content; else the one that was this file before it changed; else new."""
        item = self._ledger.by_content(content, entry.overrides) if content else None
        item = item or self._ledger.by_name(path, entry.overrides)
        if item is not None:
            return item
        name = _item_name(path, entry, content)
        while self._ledger.item(name) is not None:
            name += "x"
        self._ledger.add_item(name, content, entry.overrides, path)
        added = self._ledger.item(name)
        assert added is not None
        return added


def _item_name(path: Path, entry: Entry, content: str) -> str:
    """A name for an item that any file system takes: what a person recognises, and the content."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", path.stem)[:40].strip("-") or "video"
    key = content or hashlib.sha256(os.fsencode(path)).hexdigest()
    name = f"{stem}-{key[:12]}"
    if entry.overrides:
        text = repr(sorted(entry.overrides.items()))
        name += f"-{hashlib.sha256(text.encode()).hexdigest()[:6]}"
    return name
