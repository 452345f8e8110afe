"""How far an archive has come: counts, rate, time left, failures by reason."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from dance2pose.archive.ledger import Ledger
from dance2pose.archive.packages import one_line


@dataclass(frozen=True)
class Status:
    """A moment of an archive. rate: items a second in the last run; None where none was done."""

    counts: dict[str, int]
    verdicts: dict[str, int]
    failures: list[tuple[str, str, int]]
    rate: float | None
    left_s: float | None

    @property
    def total(self) -> int:
        return sum(self.counts.values())

    def to_json(self) -> dict[str, Any]:
        return {
            "items": self.total,
            **{state: self.counts.get(state, 0) for state in _STATES},
            "verdicts": self.verdicts,
            "items_per_hour": None if self.rate is None else round(self.rate * 3600, 1),
            "seconds_left": None if self.left_s is None else round(self.left_s),
            "failures": [
                {"reason": kind, "items": count, "example": example}
                for kind, example, count in self.failures
            ],
        }

    def lines(self) -> list[str]:
        """For a person."""
        states = ", ".join(f"{self.counts.get(state, 0)} {state}" for state in _STATES)
        lines = [f"{self.total} items: {states}"]
        if self.verdicts:
            by = (f"{self.verdicts[v]} {v}" for v in _VERDICTS if v in self.verdicts)
            lines.append(f"verdicts: {', '.join(by)}")
        if self.rate:
            left = "" if not self.left_s else f", about {duration(self.left_s)} left"
            lines.append(f"{self.rate * 3600:.1f} items an hour in the last run{left}")
        for kind, example, count in self.failures:
            lines.append(f"failed ({kind or 'unknown'}): {count}, as {one_line(example)}")
        return lines


_STATES = ("waiting", "running", "done", "failed")
_VERDICTS = ("good", "review", "poor", "unknown")


def read_status(ledger: Ledger, now: float | None = None) -> Status:
    """The status from the ledger; every sum is made in SQLite."""
    counts = ledger.counts()
    started = ledger.fact("session started")
    rate = left = None
    if started is not None:
        done, last = ledger.finished_since(float(started))
        if done and last is not None:
            end = (now or time.time()) if counts.get("running") else last
            rate = done / max(end - float(started), 1e-3)
            left = (counts.get("waiting", 0) + counts.get("running", 0)) / rate
    return Status(counts, ledger.verdicts(), ledger.failures(), rate, left)


def duration(seconds: float) -> str:
    """A time span in the two units that a person thinks in."""
    minutes, hours, days = seconds / 60, seconds / 3600, seconds / 86400
    if days >= 2:
        return f"{int(days)} days {int(hours % 24)} h"
    if hours >= 1:
        return f"{int(hours)} h {int(minutes % 60)} min"
    return f"{int(minutes)} min {int(seconds % 60)} s"
