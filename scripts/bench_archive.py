"""What a batch costs beside the work itself, measured with a stand-in for that work.

    python scripts/bench_archive.py [--items 10000]

The stand-in makes no package (`stub_without_package`) and so measures the ledger, the loop and
the workers' pipes; a part of the items is then done with packages on the disk. Also measured:
`status`, `report`, the memory of the batch's process, and two workers against one over items that
each need a fixed amount of computing in one thread.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import itertools
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil

from dance2pose.archive import batch as batch_module
from dance2pose.archive import packages
from dance2pose.archive.batch import Batch
from dance2pose.archive.jobs import Job, Outcome
from dance2pose.archive.layout import Archive, create_archive
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.options import BatchOptions
from dance2pose.archive.planning import Planner
from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.report import write_report
from dance2pose.archive.sources import find_entries
from dance2pose.archive.status import read_status
from dance2pose.archive.workspace import workspace
from dance2pose.progress import Silent

QUALITY = {"verdict": "review", "reasons": ["a stand-in"], "frames": 7, "dancers": 2}
_ROUNDS = 400_000


def stub_without_package(job: Job) -> Outcome:
    """A stand-in that does nothing."""
    return Outcome(job.item, job.version, job.fingerprint, package=job.work, quality=QUALITY)


def stub_with_package(job: Job) -> Outcome:
    """A stand-in that makes a package of three small files."""
    with workspace(job) as (folder, _):
        (folder / "poses.csv").write_text("frame\n1\n")
        (folder / "quality.json").write_text("{}")
        packages.write_card(folder, job, started=0.0, seconds=0.0)
        packages.make_bag(folder, packages.bag_info(job))
        return Outcome(job.item, job.version, job.fingerprint, package=folder, quality=QUALITY)


def stub_that_computes(job: Job) -> Outcome:
    """A stand-in that keeps one thread busy for about a quarter of a second."""
    digest = job.sha256.encode()
    for _ in range(_ROUNDS):
        digest = hashlib.sha256(digest).digest()
    return stub_without_package(job)


@dataclass(frozen=True)
class Took:
    """Seconds by the clock, and of processor time in this process: the same on a free machine."""

    clock: float
    processor: float

    @classmethod
    def now(cls) -> Took:
        return cls(time.monotonic(), time.process_time())

    def __sub__(self, other: Took) -> Took:
        return Took(self.clock - other.clock, self.processor - other.processor)

    def __str__(self) -> str:
        return f"{self.clock:.2f} s by the clock, {self.processor:.2f} s of processor time"

    def rate(self, items: int) -> str:
        return (
            f"{items / self.clock:.0f} items/s by the clock, {items / self.processor:.0f} by "
            "processor time"
        )


def measure(
    source: Path, archive: Archive, stage: str, workers: int, *, places: bool
) -> tuple[Took, Took, list[int]]:
    """What planning and the batch took, and the memory of this process on the way in bytes."""
    memory: list[int] = []
    with contextlib.closing(Ledger(archive.ledger)) as ledger:
        began = Took.now()
        plan = Planner(ledger, Recipe(), Silent()).planned(find_entries(source))
        planned = Took.now()
        run = Batch(
            archive,
            ledger,
            Recipe(),
            BatchOptions(workers=workers),
            QualityLimits(),
            _Watched(memory),
            f"bench_archive:{stage}",
        )
        place = packages.place
        if not places:
            batch_module.packages.place = lambda package, destination: None
        try:
            tally = run.run(plan.to_do)
        finally:
            batch_module.packages.place = place
        assert tally.done == plan.to_do, tally
        return planned - began, Took.now() - planned, memory


class _Watched(Silent):
    """Notes the memory of this process every 1,000 items."""

    def __init__(self, memory: list[int]) -> None:
        self._memory = memory

    def track(self, items, description, *, total=None, unit="frame"):  # type: ignore[no-untyped-def]
        for number, item in enumerate(items):
            if number % 1000 == 0:
                self._memory.append(psutil.Process().memory_info().rss)
            yield item


@contextlib.contextmanager
def fresh(folder: Path) -> Iterator[Archive]:
    """A new archive that goes at the end."""
    archive = create_archive(folder)
    yield archive
    shutil.rmtree(folder)


def timed(work) -> Took:  # type: ignore[no-untyped-def]
    began = Took.now()
    work()
    return Took.now() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--items", type=int, default=10_000)
    arguments = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = folder / "source"
        source.mkdir()
        for number in range(arguments.items):
            (source / f"{number:05d}.mp4").write_bytes(b"%d" % number)
        with fresh(folder / "a") as archive:
            planning, seconds, memory = measure(
                source, archive, "stub_without_package", 2, places=False
            )
            print(f"{arguments.items} items: found in {planning}")
            print(f"ledger and loop: {seconds.rate(arguments.items)}")
            steady = [round(b / 1e6) for b in memory[1:]]
            print(f"memory of the batch, MB: {min(steady)} to {max(steady)}")
            with contextlib.closing(Ledger(archive.ledger, read_only=True)) as ledger:
                print(f"status: {timed(lambda: read_status(ledger))}")
                print(f"report: {timed(lambda: write_report(archive, ledger))}")
        part = folder / "part"
        part.mkdir()
        for path in itertools.islice(sorted(source.iterdir()), 300):
            path.rename(part / path.name)
        with fresh(folder / "b") as archive:
            _, seconds, _ = measure(part, archive, "stub_with_package", 2, places=True)
            print(f"with packages on the disk: {seconds.rate(300)}")
        few = folder / "few"
        few.mkdir()
        for path in itertools.islice(sorted(part.iterdir()), 40):
            path.rename(few / path.name)
        speeds: dict[int, list[float]] = {}
        for workers in (1, 2, 1, 2):
            with fresh(folder / "c") as archive:
                _, seconds, _ = measure(few, archive, "stub_that_computes", workers, places=False)
                speeds.setdefault(workers, []).append(40 / seconds.clock)
        print(f"two workers: {max(speeds[2]) / max(speeds[1]):.2f} x one")


if __name__ == "__main__":
    main()
