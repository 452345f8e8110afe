"""All experiments, and the report of them: Markdown, CSV and, with matplotlib, PNG."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import scipy

from dance2pose import __version__
from dance2pose.errors import DataError, OutputError
from dance2pose.evaluation.cameras import MM_PER_PIXEL, scenes
from dance2pose.evaluation.claims import learned_from, overlap_sentence
from dance2pose.evaluation.lifter_experiments import lifter_tables, skeleton_table
from dance2pose.evaluation.limits_check import TURNED_DEGREES, JointLimits
from dance2pose.evaluation.limits_check import score as score_limits
from dance2pose.evaluation.own_bodies import DESCRIPTION, own_bodies_tables
from dance2pose.evaluation.paper_experiments import WINDOWS
from dance2pose.evaluation.paper_report import paper_part
from dance2pose.evaluation.path_experiment import path_table
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.evaluation.writing import ASSETS, REPORT, Report
from dance2pose.limits import model as limits
from dance2pose.mocap.corpus import Take, read_takes
from dance2pose.output_files import check_output
from dance2pose.progress import Progress

_FEWEST_FRAMES = 4 * max(WINDOWS)
_SKELETONS = ("cmu17", "paper15", "body17")


def evaluate(
    data: Path,
    output: Path,
    settings: EvaluationSettings,
    *,
    progress: Progress,
    overwrite: bool = False,
    published_limits: Sequence[tuple[str, JointLimits]] = (),
) -> list[Path]:
    """Run all experiments on the takes in `data` and write the report to the folder `output`.

    Returns the files written. Raises DataError for takes that cannot be read, OutputError where
    the report cannot be written (checked before any work).
    """
    report = Report(_folder(output, overwrite=overwrite), overwrite)
    start = time.monotonic()
    takes = list(progress.track(read_takes(data), "reading takes", unit="take"))
    _check_takes(takes, data, settings.rate_hz)
    _introduction(report, data, takes, settings, with_published=bool(published_limits))
    _own_bodies_part(report, data, settings, progress)
    if settings.only_own_bodies:
        return _finished(report, start)
    paper_part(report, takes, settings, progress)
    report.heading(
        "Lifters compared",
        f"At {settings.rate_hz:g} frames a second. `paper` is `--lifter paper`, frame by frame "
        "(the baseline); `paper, as written` is the same pursuit without what dance2pose adds to "
        "it. σ counts errors of position in the camera's axes, hips together, "
        "without alignment.",
    )
    for table in lifter_tables(takes, settings, progress):
        report.table(table)
    by_skeleton = {name: takes if name == "cmu17" else _takes(data, name) for name in _SKELETONS}
    report.table(skeleton_table(by_skeleton, settings, progress))
    report.table(path_table(takes, settings, progress))
    _limits_part(report, by_skeleton, settings, published_limits)
    return _finished(report, start)


def _finished(report: Report, start: float) -> list[Path]:
    report.parts.append(f"Time taken: {(time.monotonic() - start) / 60:.1f} minutes.")
    report.write()
    return report.files


def _own_bodies_part(
    report: Report, data: Path, settings: EvaluationSettings, progress: Progress
) -> None:
    report.heading("Any dancer: bodies that the lifter does not know", DESCRIPTION)
    takes = list(read_takes(data, own_bones=True))
    for table in own_bodies_tables(takes, settings, progress):
        report.table(table)


def _folder(output: Path, *, overwrite: bool) -> Path:
    try:
        (output / ASSETS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{output}: cannot be made a folder: {error.strerror}") from error
    check_output(output / REPORT, overwrite=overwrite)
    return output


def _takes(data: Path, skeleton: str) -> list[Take]:
    return list(read_takes(data, skeleton))


def _check_takes(takes: Sequence[Take], data: Path, rate_hz: float) -> None:
    for take in takes:
        seconds = len(take.xyz) / take.rate_hz
        if seconds * min(rate_hz, take.rate_hz) < _FEWEST_FRAMES:
            raise DataError(
                f"{data}: the take {take.name} is {seconds:.1f} s long; the experiments need "
                f"{_FEWEST_FRAMES} frames at {rate_hz:g} frames a second"
            )


def _introduction(
    report: Report,
    data: Path,
    takes: Sequence[Take],
    settings: EvaluationSettings,
    *,
    with_published: bool,
) -> None:
    frames = sum(len(take.xyz) for take in takes)
    listed = ", ".join(f"{t.name} ({len(t.xyz)} at {t.rate_hz:g} Hz)" for t in takes)
    command = f"dance2pose evaluate {data.name} -o {report.folder.name}"
    for name, value in asdict(settings).items():
        if value != getattr(EvaluationSettings(), name):
            option = name.replace("_", "-")
            command += f" --{option}" if value is True else f" --{option} {value}"
    if with_published:
        command += " --authors-limits FOLDER"
    versions = (
        f"dance2pose {__version__}, NumPy {np.__version__}, SciPy {scipy.__version__}, "
        f"Python {platform.python_version()}"
    )
    claim = overlap_sentence([take.name for take in takes], learned_from())
    report.parts += [
        "# Evaluation",
        f"Made by `{command}` with {versions}.",
        f"**Data.** {len(takes)} takes, {frames:,} frames: {listed}; {claim}. First joint at the "
        "origin; where nothing is said of own bodies, all on one body (1.65 m).",
        f"**Cameras.** Where nothing else is said: orthographic, {MM_PER_PIXEL:g} mm a pixel. "
        f"Cameras stand evenly around every take ({settings.views}, where nothing else is said), "
        "the first azimuth of a take drawn at random; tilts are drawn uniformly within "
        f"±{settings.tilt_deg:g}°.",
        "**Measure.** PA-MPJPE: mean distance of the joints after the best translation, rotation "
        "and uniform scale of each frame, without reflection unless said otherwise. Averages are "
        "over frames, then cameras, then takes: a long take counts no more than a short one.",
        "**Settings.** "
        + ", ".join(f"{name} = {value}" for name, value in asdict(settings).items())
        + ". Everything random comes from the seed.",
    ]


def _limits_part(
    report: Report,
    takes: dict[str, list[Take]],
    settings: EvaluationSettings,
    published: Sequence[tuple[str, JointLimits]],
) -> None:
    known: list[tuple[str, JointLimits]] = [
        (f"learned here, {name}", limits.load(name)) for name in takes
    ]
    rows: list[list[Cell]] = []
    for name, model in [*known, *published]:
        some = scenes(
            takes[model.skeleton], views=1, tilt_deg=0, seed=settings.seed, rate_hz=settings.rate_hz
        )
        poses = np.concatenate([scene.truth for scene in some])
        found = score_limits(model, poses, np.random.default_rng(settings.seed))
        worst = int(found.valid.argmin())
        rows.append(
            [
                name,
                100 * float(found.valid.mean()),
                100 * float(found.valid[worst]),
                found.bones[worst],
                100 * float(found.refused.mean()),
                100 * float(found.refused.min()),
            ]
        )
    report.heading("Joint-angle limits")
    report.table(
        Table(
            "limits",
            "Limits on the true poses of these takes, %",
            (
                "",
                "limited bones valid",
                "worst bone",
                "which",
                f"turned by more than {TURNED_DEGREES:g}°: refused",
                "least refused bone",
            ),
            rows,
            digits=2,
            note="How the margin was chosen, on training takes held out: "
            f"[limits_trade_off.md]({ASSETS}/limits_trade_off.md)."
            if (report.assets / "limits_trade_off.md").is_file()
            else "",
        )
    )
