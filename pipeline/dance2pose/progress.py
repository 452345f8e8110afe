"""What a person sees while work runs: stages and bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """Where a long job says what it is doing."""

    def say(self, text: str) -> None:
        """One line that stays."""
        ...

    def track(
        self, items: Iterable[T], description: str, *, total: int | None = None, unit: str = "frame"
    ) -> Iterator[T]:
        """Pass the items on, showing how many have gone, how fast, and how long is left."""
        ...


class Silent:
    """Shows nothing (`--quiet`, tests, library use)."""

    def say(self, text: str) -> None:
        del text

    def track(
        self, items: Iterable[T], description: str, *, total: int | None = None, unit: str = "frame"
    ) -> Iterator[T]:
        del description, total, unit
        yield from items


class PlainLines:
    """Plain lines on stderr for logs: one every `every_s` seconds and one at the end of a stage."""

    def __init__(self, every_s: float = 10.0) -> None:
        self.every_s = every_s

    def say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def track(
        self, items: Iterable[T], description: str, *, total: int | None = None, unit: str = "frame"
    ) -> Iterator[T]:
        of_total = f" of {total}" if total else ""
        start = last = time.monotonic()
        count = 0
        for item in items:
            yield item
            count += 1
            now = time.monotonic()
            if now - last >= self.every_s:
                last = now
                rate = count / (now - start)
                left = f", {(total - count) / rate:.0f} s left" if total else ""
                self.say(f"{description}: {count}{of_total} {unit}s, {rate:.1f} {unit}s/s{left}")
        seconds = time.monotonic() - start
        self.say(
            f"{description}: {count} {unit}s in {seconds:.1f} s"
            f" ({count / max(seconds, 1e-9):.1f} {unit}s/s)"
        )


class TerminalBar:
    """A rich progress bar on stderr."""

    def say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def track(
        self, items: Iterable[T], description: str, *, total: int | None = None, unit: str = "frame"
    ) -> Iterator[T]:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TaskProgressColumn(show_speed=False),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task(description, total=total, rate="")
            start = time.monotonic()
            for count, item in enumerate(items, start=1):
                yield item
                rate = count / max(time.monotonic() - start, 1e-9)
                bar.update(task, completed=count, rate=f"{rate:.1f} {unit}s/s")


def for_terminal(*, quiet: bool) -> Progress:
    """The progress display that fits where stderr goes."""
    if quiet:
        return Silent()
    return TerminalBar() if sys.stderr.isatty() else PlainLines()
