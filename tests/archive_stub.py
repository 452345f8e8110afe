"""Stand-ins for the work on one video, for tests of everything around it.

What a stand-in does is told by the name of the video: `abort`, `hang`, `hungry`, `full`, else it
makes a small package at once. Run as a program it is a batch with the stand-in, to be killed.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from pathlib import Path

from dance2pose.archive import packages
from dance2pose.archive.jobs import Job, Outcome
from dance2pose.archive.layout import Archive
from dance2pose.archive.options import BatchOptions
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.running import BatchResult, run_batch
from dance2pose.archive.workspace import workspace
from dance2pose.errors import VideoError
from dance2pose.options import Settings
from dance2pose.progress import Silent

STAGE = "archive_stub:stub_item"
PACKAGE_SECONDS = float(os.environ.get("STUB_SECONDS", "0"))
QUALITY = {"verdict": "review", "reasons": ["a stand-in"], "frames": 7, "dancers": 2}


def stub_item(job: Job) -> Outcome:
    """A stand-in for `worker.process_item`."""
    started = time.time()
    _misbehave(job.source.name)
    with workspace(job) as (folder, seen):
        (folder / "poses.csv").write_text(f"frame\n{job.sha256}\n")
        time.sleep(PACKAGE_SECONDS)
        (folder / "quality.json").write_text('{"verdict": "review"}')
        packages.write_card(folder, job, started=started, seconds=0.5)
        packages.make_bag(folder, packages.bag_info(job))
        return Outcome(
            job.item,
            job.version,
            job.fingerprint,
            package=folder if seen else None,
            packed=None if seen else packages.packed(folder),
            quality=QUALITY,
            started=started,
            worker=f"process {os.getpid()}",
        )


def models_item(job: Job) -> Outcome:
    """Tells what the models of its recipe hold, and whether they lie where they were sent from."""
    told = {
        name: [
            path.read_text(),
            path.with_suffix(".toml").read_text(),
            path.is_relative_to(job.source.parents[1]),
        ]
        for name, path in job.recipe.models().items()
    }
    return Outcome(job.item, job.version, job.fingerprint, quality=told)


def _misbehave(name: str) -> None:
    if "abort" in name:
        os.write(2, b"libfaulty: assertion failed\n")
        os.abort()
    if "hang" in name:
        time.sleep(600)
    if "hungry" in name:
        hoard = []
        while True:
            hoard.append(b"x" * 10_000_000)
            time.sleep(0.01)
    if "full" in name:
        raise OSError(errno.ENOSPC, "No space left on device", name)
    if "broken" in name:
        raise VideoError(f"{name}: is not a video")


def batch(
    source: Path, archive: Path, settings: Settings | None = None, **options: object
) -> BatchResult:
    """A batch with the stand-in."""
    return run_batch(
        source,
        archive,
        Recipe(settings=settings or Settings()),
        options=BatchOptions(**{"workers": 2, **options}),  # type: ignore[arg-type]
        progress=Silent(),
        stage=STAGE,
    )


def videos(folder: Path, *names: str) -> Path:
    """A folder of files with the names of videos, each with other content."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_bytes(f"content of {name}".encode("utf-8", "surrogateescape"))
    return folder


def damage(archive: Path) -> list[str]:
    """What bagit itself finds wrong with the packages of an archive."""
    import bagit

    found = []
    for item, version, folder in Archive(archive).found_packages():
        try:
            bagit.Bag(str(folder)).validate()
        except bagit.BagError as error:
            found.append(f"{item}/v{version}: {error}")
    return found


if __name__ == "__main__":
    batch(Path(sys.argv[1]), Path(sys.argv[2]), Settings.of(window=int(sys.argv[3])), attempts=1000)
