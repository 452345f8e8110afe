"""What goes to a worker and what comes back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.recipe import Recipe

Failure = Literal[
    "", "input", "crash", "time", "memory", "disk full", "internal", "stopped", "worker lost"
]
"""Why an item did not get done: the video itself (input), its worker died (crash), a limit (time,
memory), no room (disk full), a fault of ours (internal), the batch was stopped, no worker."""

# Another attempt can end differently after these; after the others it cannot, or is no use.
WORTH_ANOTHER_ATTEMPT = frozenset({"crash", "time", "memory", "worker lost"})
# These say nothing about the item: it stays waiting.
NOT_THE_ITEMS_FAULT = frozenset({"disk full", "stopped"})


@dataclass(frozen=True)
class Job:
    """One video to process. names, paths, metadata: of every name it was found under, as given.

    recipe: with the row's own settings in place. work: folder of the archive where a
    package is made before it is put in its place. stage: what is called for it in the worker, as
    module:function; tests put a stand-in there.
    """

    item: str
    version: int
    source: Path
    sha256: str
    fingerprint: str
    recipe: Recipe
    quality: QualityLimits
    archive: str
    work: Path
    names: tuple[str, ...] = ()
    paths: tuple[Path, ...] = ()
    metadata: tuple[dict[str, str], ...] = ()
    overrides: dict[str, str] = field(default_factory=dict)
    stage: str = ""


@dataclass(frozen=True)
class Outcome:
    """What came of a job.

    package: the finished package in the archive's work folder, or where the worker has no such
    folder, `packed`: the same as bytes (an uncompressed ZIP file). quality: as in
    `quality.Quality.to_json`.
    """

    item: str
    version: int
    fingerprint: str
    failure: Failure = ""
    error: str = ""
    package: Path | None = None
    packed: bytes | None = None
    quality: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    started: float = 0.0
    worker: str = ""


def failed(job: Job, failure: Failure, error: str, **known: Any) -> Outcome:
    """The outcome of a job that did not get done."""
    text = error.encode("utf-8", "backslashreplace").decode()
    return Outcome(job.item, job.version, job.fingerprint, failure, text, **known)
