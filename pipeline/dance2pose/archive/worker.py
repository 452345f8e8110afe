"""One item, from video to package; runs in a worker's process."""

from __future__ import annotations

import csv
import json
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

from dance2pose.archive import packages, prov
from dance2pose.archive.jobs import Job, Outcome
from dance2pose.archive.quality import Quality, assess
from dance2pose.archive.sources import why_unreadable
from dance2pose.archive.thumbnails import Thumbnails
from dance2pose.archive.workspace import workspace
from dance2pose.errors import DataError, UsageError
from dance2pose.options import OutputOptions, Settings
from dance2pose.people import PoseModels, load_models
from dance2pose.reconstruction import Reconstruction, analyse

# Forms of every package, beside the recording and the arrays: text that any program can read.
LASTING = (".csv", ".json", ".bvh")


def process_item(job: Job) -> Outcome:
    """Make the package of one video: recording, poses, metadata, provenance, quality.

    Raises a Dance2PoseError for anything that is the matter with the video; nothing stays then.
    """
    started = time.time()
    use_one_thread()
    problem = why_unreadable(job.source)
    if problem:
        raise DataError(f"{job.source}: {problem}")
    with workspace(job) as (folder, seen):
        found = _reconstructed(job, folder)
        if found.source.sha256 != job.sha256:
            raise DataError(f"{job.source}: has changed since the batch began; start it again")
        quality = _write_beside(job, folder, found, started)
        packages.make_bag(folder, packages.bag_info(job))
        return Outcome(
            job.item,
            job.version,
            job.fingerprint,
            package=folder if seen else None,
            packed=None if seen else packages.packed(folder),
            quality=quality.to_json(),
            seconds=time.time() - started,
            started=started,
        )


def _reconstructed(job: Job, folder: Path) -> Reconstruction:
    """Run the reconstruction; recording.rrd, poses, keypoints and thumbnails go to the folder."""
    thumbnails = Thumbnails()
    settings, outputs = job.recipe.settings, job.recipe.outputs
    models = _models(settings.detector, settings.pose)
    found = analyse(job.source, settings, on_frame=thumbnails, models=models)
    found.save(folder / "recording.rrd", picture=outputs.picture)
    if outputs.npz:
        found.save(folder / "poses.npz")
    thumbnails.write(folder / "thumbnails.jpg", [dancer.keypoints for dancer in found.dancers])
    return found


@cache
def _models(detector: Path | None, pose: Path | None) -> PoseModels:
    """The models, loaded once in the life of a worker."""
    return load_models(Settings(detector=detector, pose=pose))


@cache
def use_one_thread() -> None:
    """Keep this process to one thread of work: the other cores are other workers'."""
    import cv2
    from threadpoolctl import threadpool_limits

    from dance2pose.onnx_models import inference

    inference.limit_threads(1)
    cv2.setNumThreads(1)
    threadpool_limits(1)


def _write_beside(job: Job, folder: Path, found: Reconstruction, started: float) -> Quality:
    """Everything of a package beside what the reconstruction wrote."""
    notes = _write_forms(found, folder, job.recipe.outputs)
    _write_metadata(folder / "metadata.csv", job.metadata)
    quality = assess(found, job.quality, body_height_m=job.recipe.settings.lift.height_m)
    quality = replace(quality, findings=(*quality.findings, *notes))
    text = json.dumps(quality.to_json(), indent=1)
    (folder / "quality.json").write_text(text + "\n", encoding="utf-8")
    ended = time.time()
    outputs = sorted(path for path in folder.iterdir() if path.is_file())
    content = prov.document(job, found.provenance, outputs, started=started, ended=ended)
    prov.write(folder / "provenance.json", content)
    packages.write_card(folder, job, started=started, seconds=ended - started)
    return quality


def _write_forms(found: Reconstruction, folder: Path, outputs: OutputOptions) -> list[str]:
    """The poses in forms that outlive any viewer, and those asked for; what could not be."""
    notes = []
    for form in dict.fromkeys((*LASTING, *outputs.forms)):
        try:
            found.save(folder / f"poses{form}")
        except UsageError as error:  # a form that cannot hold this result, as one without joints
            notes.append(f"not written as {form.removeprefix('.')}: {error}")
    return notes


def _write_metadata(path: Path, rows: tuple[dict[str, str], ...]) -> None:
    """The rows of the source's table about this video, every column as it was given."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    with path.open("w", encoding="utf-8", newline="", errors="backslashreplace") as file:
        writer = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
