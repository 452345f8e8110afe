"""The experiments of the paper (Nguyen, Ngo, Le): Table 1, noise, smoothness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.evaluation.cameras import Scene, with_snr
from dance2pose.evaluation.lifters import PAPER, LifterEntry, paper_ablations
from dance2pose.evaluation.metrics import signal_to_noise_sigma
from dance2pose.evaluation.scoring import Run, Scores, lift_scenes, perturbed, score
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.poses import FloatArray
from dance2pose.progress import Progress
from dance2pose.smoothing import MODELS, smooth

# The paper's temporal models; "none" is its baseline, frame by frame.
PAPER_MODELS = ("sma", "ema", "wma", "mma")
# The paper's Table 1, percent of the baseline, its joints in its order under the names of cmu17.
# (Its second "L-Shoulder" is the left hip: a misprint.)
PAPER_TABLE: dict[str, tuple[float, float, float, float]] = {
    "root": (84.93, 84.50, 85.78, 81.33),
    "upper_back": (86.65, 85.34, 87.59, 82.83),
    "left_shoulder": (85.57, 84.63, 86.29, 81.78),
    "left_elbow": (84.18, 83.53, 85.01, 80.54),
    "left_wrist": (94.07, 93.65, 94.35, 92.74),
    "right_shoulder": (89.12, 85.67, 89.80, 86.82),
    "right_elbow": (86.60, 85.83, 87.04, 82.93),
    "right_wrist": (88.79, 88.25, 89.22, 85.53),
    "head": (88.35, 87.25, 88.98, 84.50),
    "right_hip": (96.86, 96.66, 97.03, 95.43),
    "right_knee": (100.56, 100.22, 100.79, 99.87),
    "right_ankle": (102.11, 98.27, 102.18, 99.13),
    "left_hip": (94.80, 94.50, 94.99, 93.63),
    "left_knee": (100.06, 99.99, 100.19, 99.08),
    "left_ankle": (100.06, 100.11, 99.81, 98.87),
}
PAPER_AVERAGE = (92.18, 91.23, 92.60, 89.67)
WINDOWS = (3, 5, 9, 15)


@dataclass(frozen=True)
class Smoothed:
    """A lifter over many scenes under several temporal models: (model, window) -> scores.

    ("none", 1) is the lifter alone.
    """

    runs: dict[tuple[str, int], Run]

    def mean(self, model: str, window: int) -> Scores:
        """The average over all scenes."""
        return self.runs[model, window].mean


def run_smoothed(
    entry: LifterEntry,
    scenes: Sequence[Scene],
    truths: Sequence[Scene],
    variants: Sequence[tuple[str, int]],
    progress: Progress,
    what: str,
) -> Smoothed:
    """Lift every scene once, then measure it under every (model, window)."""
    scores: dict[tuple[str, int], list[tuple[str, Scores]]] = {v: [] for v in variants}
    seconds = 0.0
    lifted = lift_scenes(entry, scenes, progress, what)
    for (scene, xyz, _, took), truth in zip(lifted, truths, strict=True):
        seconds += took
        for model, window in variants:
            after = smoothed(xyz, model, window, scene.rate_hz)
            scores[model, window].append((scene.take, score(truth, after)))
    rate = sum(len(s.xy) for s in scenes) / max(seconds, 1e-9)
    return Smoothed({variant: Run(found, rate) for variant, found in scores.items()})


def smoothed(xyz: FloatArray, model: str, window: int, rate_hz: float) -> FloatArray:
    """Poses (T, J, 3) under a temporal model."""
    return smooth(xyz, model=model, window=window, time_s=np.arange(len(xyz)) / rate_hz)


def paper_variants(windows: Sequence[int]) -> list[tuple[str, int]]:
    """The baseline and the paper's models at the windows."""
    return [("none", 1), *((model, w) for w in windows for model in PAPER_MODELS)]


def table_1(result: Smoothed, window: int, where: str) -> Table:
    """Per joint and on average, percent of the baseline, the paper's numbers beside ours."""
    base = result.mean("none", 1).pa
    ours = {model: result.mean(model, window).pa for model in PAPER_MODELS}
    tree = skeletons.get("cmu17")
    columns = [tree.index(joint) for joint in PAPER_TABLE]
    rows: list[list[Cell]] = []
    for joint, column in zip(PAPER_TABLE, columns, strict=True):
        row: list[Cell] = [joint.replace("_", " "), float(base[column])]
        for model, published in zip(PAPER_MODELS, PAPER_TABLE[joint], strict=True):
            row += [100 * float(ours[model][column] / base[column]), published]
        rows.append(row)
    row = ["average of these 15", float(base[columns].mean())]
    for model, published in zip(PAPER_MODELS, PAPER_AVERAGE, strict=True):
        row += [100 * float(ours[model][columns].mean() / base[columns].mean()), published]
    rows.append(row)
    header = ["joint", "baseline, mm"]
    for model in PAPER_MODELS:
        header += [f"{model.upper()} %", "paper %"]
    return Table(
        f"table_1_{where.replace(',', '').replace(' ', '_')}",
        f"Table 1 of the paper, {where}, window {window}: PA error in % of the baseline",
        tuple(header),
        rows,
        digits=2,
    )


def absolute_table(results: dict[str, Smoothed], window: int) -> Table:
    """PA-MPJPE in mm with and without reflection, over all 17 joints."""
    rows: list[list[Cell]] = []
    for where, result in results.items():
        for model, w in [("none", 1), *((model, window) for model in PAPER_MODELS)]:
            mean = result.mean(model, w)
            rows.append(
                [
                    f"{where}, {'baseline' if model == 'none' else model.upper()}",
                    mean.pa_mean,
                    float(mean.pa_reflected.mean()),
                    float(mean.mpjpe),
                ]
            )
    return Table(
        "absolute_errors",
        "The same in mm, over all 17 joints",
        ("", "PA-MPJPE", "with reflection allowed", "MPJPE"),
        rows,
        digits=2,
    )


def window_table(results: dict[str, Smoothed], windows: Sequence[int]) -> Table:
    """The average of Table 1 for other windows: the paper does not say which it used."""
    rows: list[list[Cell]] = []
    tree = skeletons.get("cmu17")
    columns = [tree.index(joint) for joint in PAPER_TABLE]
    for where, result in results.items():
        base = result.mean("none", 1).pa[columns].mean()
        for window in windows:
            means = [result.mean(model, window).pa[columns].mean() for model in PAPER_MODELS]
            rows.append([f"{where}, window {window}", *(100 * float(m / base) for m in means)])
    rows.append(["the paper (window not stated)", *PAPER_AVERAGE])
    return Table(
        "windows",
        "Average of Table 1 for other windows, % of the baseline",
        ("", *(model.upper() for model in PAPER_MODELS)),
        rows,
        digits=2,
    )


def noise_tables(
    scenes: Sequence[Scene], settings: EvaluationSettings, progress: Progress
) -> tuple[Table, Table]:
    """Error against the signal-to-noise ratio of the 2D input in mm, and in % of the baseline."""
    variants = paper_variants([settings.window])
    millimetres: list[list[Cell]] = []
    percent: list[list[Cell]] = []
    for snr in settings.snr_db:
        noisy = perturbed(scenes, partial(with_snr, snr_db=snr), settings.seed)
        result = run_smoothed(PAPER, noisy, scenes, variants, progress, f"noise of {snr:g} dB")
        errors = [result.mean(*variant).pa_mean for variant in variants]
        sigma = float(np.mean([signal_to_noise_sigma(scene.xy, snr) for scene in scenes]))
        millimetres.append([f"{snr:g}", sigma, *errors])
        percent.append([f"{snr:g}", *(100 * error / errors[0] for error in errors[1:])])
    models = [model.upper() for model in PAPER_MODELS]
    return (
        Table(
            "noise",
            "PA-MPJPE in mm against the signal-to-noise ratio of the 2D input",
            ("SNR, dB", "noise σ, mm", "baseline", *models),
            millimetres,
        ),
        Table("noise_percent", "The same in % of the baseline", ("SNR, dB", *models), percent),
    )


def smoothness_variants(windows: Sequence[int]) -> list[tuple[str, int]]:
    """The baseline and every temporal model at the windows, which must be odd."""
    return [("none", 1), *((m, w) for m in MODELS if m != "none" for w in windows)]


def smoothness_table(result: Smoothed, rate_hz: float) -> Table:
    """Acceleration error, jerk and lag against the truth for every model and window."""
    rows: list[list[Cell]] = []
    for model, window in result.runs:
        mean = result.mean(model, window)
        rows.append(
            [
                "baseline" if model == "none" else f"{model}, {window}",
                mean.pa_mean,
                float(mean.acceleration) / 1000,
                float(mean.jerk / mean.true_jerk),
                float(mean.lag),
                "" if model == "none" else MODELS[model].lag(window),
            ]
        )
    return Table(
        "smoothness",
        f"Smoothness of the paper's lifter at {rate_hz:g} frames a second",
        (
            "model, window",
            "PA-MPJPE, mm",
            "acceleration error, m/s²",
            "jerk / true jerk",
            "lag measured, frames",
            "lag in theory",
        ),
        rows,
        digits=2,
    )


def ablation_table(
    scenes: Sequence[Scene], settings: EvaluationSettings, progress: Progress
) -> Table:
    """The average of Table 1 without limits, without the anthropometric constraint, other K."""
    variants = paper_variants([settings.window])
    rows: list[list[Cell]] = []
    for entry in (PAPER, *paper_ablations()):
        result = run_smoothed(entry, scenes, scenes, variants, progress, "ablation")
        base = result.mean("none", 1)
        percent = [
            100 * result.mean(model, settings.window).pa_mean / base.pa_mean
            for model in PAPER_MODELS
        ]
        rows.append([entry.name, base.pa_mean, 100 * float(base.valid), *percent])
    return Table(
        "ablation_paper",
        f"The paper's lifter with parts taken off, window {settings.window}",
        (
            "",
            "baseline PA-MPJPE, mm",
            "valid bones, %",
            *(f"{model.upper()} % of its baseline" for model in PAPER_MODELS),
        ),
        rows,
    )
