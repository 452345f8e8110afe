"""Every lifter under the same conditions, and what each part of the default one brings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dance2pose.evaluation.cameras import Scene, scenes, with_missing, with_noise
from dance2pose.evaluation.lifters import (
    AS_WRITTEN,
    DEFAULT,
    PAPER,
    LifterEntry,
    default_ablations,
    lifters,
)
from dance2pose.evaluation.paper_experiments import run_smoothed
from dance2pose.evaluation.scoring import Run, by_take, perturbed, run
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.mocap.corpus import Take
from dance2pose.progress import Progress


@dataclass(frozen=True)
class Condition:
    """What the lifters are given (`seen`) and what they are measured against (`truth`)."""

    name: str
    seen: list[Scene]
    truth: list[Scene]


def conditions(
    takes: Sequence[Take], settings: EvaluationSettings, views: int
) -> dict[str, Condition]:
    """clean, noise, missing, and cameras at every tilt."""
    make = partial(scenes, takes, views=views, seed=settings.seed, rate_hz=settings.rate_hz)
    clean, steep = make(tilt_deg=settings.tilt_deg), make(tilt_deg=90.0)
    noisy = perturbed(clean, partial(with_noise, sigma_mm=settings.noise_mm), settings.seed)
    cut = perturbed(clean, partial(with_missing, share=settings.missing), settings.seed)
    return {
        "clean": Condition("clean 2D", clean, clean),
        "noise": Condition(f"noise of {settings.noise_mm:g} mm", noisy, clean),
        "missing": Condition(f"{settings.missing:.0%} of joints missing", cut, clean),
        "steep": Condition("tilt ±90°", steep, steep),
    }


Results = dict[tuple[str, str], Run]


def run_lifters(
    entries: Sequence[LifterEntry], given: dict[str, Condition], progress: Progress
) -> Results:
    """Every lifter under every condition: (lifter, condition) -> scores."""
    return {
        (entry.name, key): run(entry, condition.seen, condition.truth, progress, condition.name)
        for entry in entries
        for key, condition in given.items()
    }


def run_paper(
    given: dict[str, Condition], model: str, window: int, progress: Progress
) -> tuple[str, Results]:
    """The paper's lifter alone and with a temporal model, and the name of the latter."""
    name = f"{PAPER.name} + {model.upper()}, window {window}"
    results: Results = {}
    for key, condition in given.items():
        both = run_smoothed(
            PAPER,
            condition.seen,
            condition.truth,
            [("none", 1), (model, window)],
            progress,
            condition.name,
        )
        results[PAPER.name, key] = both.runs["none", 1]
        results[name, key] = both.runs[model, window]
    return name, results


def accuracy_table(
    results: Results, names: Sequence[str], given: dict[str, Condition], *, name: str, title: str
) -> Table:
    """PA-MPJPE in mm under every condition, and the clean one as a share of the paper lifters'."""
    rows: list[list[Cell]] = [
        [lifter, *(results[lifter, key].mean.pa_mean for key in given)] for lifter in names
    ]
    header = ["PA-MPJPE, mm", *(condition.name for condition in given.values())]
    for base in (PAPER, AS_WRITTEN):
        if base.name in names:
            whole = results[base.name, "clean"].mean.pa_mean
            header.append(f"clean, % of {base.name!r}")
            for lifter, row in zip(names, rows, strict=True):
                row.append(100 * results[lifter, "clean"].mean.pa_mean / whole)
    return Table(name, title, tuple(header), rows)


def quality_table(results: Results, names: Sequence[str], *, name: str, title: str) -> Table:
    """What accuracy does not say, on clean 2D: smoothness, lag, limits, bones, sigma."""
    rows: list[list[Cell]] = []
    for lifter in names:
        run_ = results[lifter, "clean"]
        mean = run_.mean
        rows.append(
            [
                lifter,
                float(mean.mpjpe),
                float(mean.pa_reflected.mean()),
                float(mean.acceleration) / 1000,
                float(mean.jerk / mean.true_jerk),
                float(mean.lag),
                100 * float(mean.valid),
                float(mean.bone_range),
                100 * float(mean.within_1),
                100 * float(mean.within_2),
                100 * float(mean.lifted),
                round(run_.frames_per_s),
            ]
        )
    return Table(
        name,
        title,
        (
            "clean 2D",
            "MPJPE, mm",
            "PA-MPJPE with reflection, mm",
            "acceleration error, m/s²",
            "jerk / true jerk",
            "lag, frames",
            "valid bones, %",
            "bone length range, mm",
            "within 1 σ, %",
            "within 2 σ, %",
            "frames lifted, %",
            "frames/s",
        ),
        rows,
        digits=2,
    )


def calibration_table(results: Results, given: dict[str, Condition]) -> Table:
    """Shares of errors within one and two sigma under every condition."""
    rows: list[list[Cell]] = []
    for key, condition in given.items():
        mean = results[DEFAULT.name, key].mean
        rows.append([condition.name, 100 * float(mean.within_1), 100 * float(mean.within_2)])
    return Table(
        "calibration",
        "Sigma of the default lifter: share of true errors within it, % (aim: 68 and 95)",
        ("", "within 1 σ", "within 2 σ"),
        rows,
    )


def takes_table(results: Results, names: Sequence[str]) -> Table:
    """PA-MPJPE of every take, clean 2D."""
    per_lifter = [by_take(results[name, "clean"].scores) for name in names]
    rows: list[list[Cell]] = [
        [take, *(scores[take].pa_mean for scores in per_lifter)] for take in per_lifter[0]
    ]
    rows.append(["mean", *(float(np.mean([s.pa_mean for s in t.values()])) for t in per_lifter)])
    return Table("takes", "PA-MPJPE of every take, mm, clean 2D", ("take", *names), rows)


def lifter_tables(
    takes: Sequence[Take], settings: EvaluationSettings, progress: Progress
) -> list[Table]:
    """All tables that compare lifters."""
    given = conditions(takes, settings, settings.views)
    after, results = run_paper(given, "mma", settings.window, progress)
    others = [entry for entry in lifters() if entry != PAPER]
    results |= run_lifters(others, given, progress)
    names = [PAPER.name, after, *(entry.name for entry in others)]
    few = conditions(takes, settings, 1)
    ablations = default_ablations()
    parts = run_lifters((DEFAULT, *ablations), few, progress)
    part_names = [DEFAULT.name, *(entry.name for entry in ablations)]
    return [
        accuracy_table(results, names, given, name="lifters", title="Lifters: accuracy"),
        quality_table(results, names, name="lifters_quality", title="Lifters: beside accuracy"),
        calibration_table(results, given),
        takes_table(results, names),
        accuracy_table(
            parts,
            part_names,
            few,
            name="ablation_default",
            title="What each part of the default lifter brings (one camera a take): accuracy",
        ),
        quality_table(
            parts,
            part_names,
            name="ablation_default_quality",
            title="What each part of the default lifter brings: beside accuracy",
        ),
    ]


def skeleton_table(
    takes_of: Mapping[str, Sequence[Take]], settings: EvaluationSettings, progress: Progress
) -> Table:
    """Both lifters on every lifting skeleton, one camera a take, clean 2D."""
    rows: list[list[Cell]] = []
    for skeleton, takes in takes_of.items():
        clean = scenes(
            takes, views=1, tilt_deg=settings.tilt_deg, seed=settings.seed, rate_hz=settings.rate_hz
        )
        means = [run(e, clean, clean, progress, skeleton).mean for e in (PAPER, DEFAULT)]
        rows.append([skeleton, *(m.pa_mean for m in means), *(100 * float(m.valid) for m in means)])
    return Table(
        "skeletons",
        "The lifting skeletons, clean 2D, one camera a take",
        (
            "",
            "paper, PA-MPJPE mm",
            "default, PA-MPJPE mm",
            "paper, valid bones %",
            "default, valid bones %",
        ),
        rows,
    )
