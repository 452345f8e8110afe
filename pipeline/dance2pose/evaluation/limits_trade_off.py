"""The margin of learned limits: what is gained in real poses is lost in impossible ones.

Every point is measured on takes held out of the corpus that the limits are learned from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose.evaluation import plots
from dance2pose.evaluation.limits_check import (
    TURNED_DEGREES,
    JointLimits,
    LimitsScore,
    score,
)
from dance2pose.evaluation.metrics import mean_over
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.limits.learning import (
    Margins,
    ObservationSettings,
    seen_directions,
    training_poses,
    widen,
)
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import FloatArray
from dance2pose.progress import Progress

MARGINS = tuple(
    Margins(occupancy, region)
    for occupancy, region in ((2, 3), (3, 6), (4, 9), (6, 12), (8, 16), (12, 20), (18, 28))
)
FOLDS = 4


def _name(margins: Margins) -> str:
    return f"{margins.occupancy_deg:g}° / {margins.region_deg:g}°"


_CHOSEN = _name(Margins())


@dataclass(frozen=True)
class Point:
    """One choice of margins on held-out takes. score: the mean of the folds."""

    name: str
    held_out: str
    score: LimitsScore


def trade_off(
    takes: Sequence[Take],
    others: Sequence[tuple[str, JointLimits]],
    *,
    seed: int,
    progress: Progress,
) -> list[Point]:
    """Scores of MARGINS with takes held out, with whole dancers held out, and of other limits."""
    points: list[Point] = []
    groups: tuple[tuple[str, Callable[[str], str]], ...] = (
        ("takes", lambda name: name),
        ("dancers", _dancer),
    )
    for held_out, group_of in groups:
        scores: list[list[LimitsScore]] = [[] for _ in MARGINS]
        for fold in progress.track(range(FOLDS), f"{held_out} held out", total=FOLDS, unit="fold"):
            learn_on, test_on = _split(takes, fold, group_of)
            poses, take = training_poses(learn_on, ObservationSettings.rate_hz)
            seen = seen_directions(poses, takes[0].skeleton, take=take)
            poses = _poses(test_on)
            for column, margins in zip(scores, MARGINS, strict=True):
                column.append(score(widen(seen, margins), poses, np.random.default_rng(seed)))
        points += [
            Point(_name(m), held_out, _mean(s)) for m, s in zip(MARGINS, scores, strict=True)
        ]
    rng = np.random.default_rng(seed)
    poses = _poses(takes)
    return points + [Point(name, "all takes", score(limits, poses, rng)) for name, limits in others]


def trade_off_table(points: Sequence[Point]) -> Table:
    """Per choice of margins: valid real bones (all and the worst bone), refused turned bones."""
    rows: list[list[Cell]] = [
        [
            point.name,
            point.held_out,
            100 * float(point.score.valid.mean()),
            100 * float(point.score.valid.min()),
            point.score.bones[int(point.score.valid.argmin())],
            100 * float(point.score.refused.mean()),
            100 * float(point.score.refused.min()),
            point.score.bones[int(point.score.refused.argmin())],
        ]
        for point in points
    ]
    return Table(
        "limits_trade_off",
        "Joint-angle limits: margin against strictness, %",
        (
            "margin of occupancy / of region",
            "held out",
            "real bones valid",
            "worst bone",
            "which",
            "turned bones refused",
            "least refused",
            "which",
        ),
        rows,
        digits=2,
        note=(
            f"The limits that come with dance2pose have margins of {_CHOSEN}. Real: poses of takes "
            f"(or of dancers) left out of the learning, {FOLDS} folds, at "
            f"{ObservationSettings.rate_hz:g} frames a second. Turned: one limited bone of such a "
            f"pose at a time, turned at random by more than {TURNED_DEGREES:g}°. Published limits "
            "are measured on all the takes as they stand; they were learned from other poses."
        ),
    )


def plot_trade_off(points: Sequence[Point], path: Path) -> None:
    """Refused turned bones over valid real bones, one line for each way of holding out."""
    series = []
    for held_out in ("takes", "dancers"):
        line = [point.score for point in points if point.held_out == held_out]
        series.append(
            plots.Series(
                f"learned here, {held_out} held out",
                np.array([100 * s.valid.mean() for s in line]),
                np.array([100 * s.refused.mean() for s in line]),
            )
        )
    chosen = [point for point in points if point.name == _CHOSEN]
    series.append(
        plots.Series(
            f"margin that dance2pose has ({_CHOSEN})",
            np.array([100 * point.score.valid.mean() for point in chosen]),
            np.array([100 * point.score.refused.mean() for point in chosen]),
        )
    )
    for point in points:
        if point.held_out not in ("takes", "dancers"):
            at = np.array([[100 * point.score.valid.mean()], [100 * point.score.refused.mean()]])
            series.append(plots.Series(point.name, at[0], at[1]))
    plots.lines(
        path,
        series,
        title="Joint-angle limits: margin against strictness",
        x_label="real bones valid, %",
        y_label="bones turned by more than 60° refused, %",
        overwrite=True,
    )


def _dancer(name: str) -> str:
    """Who dances in a CMU take: the number before the first underscore (the salsa files' two
    dancers share one)."""
    return name.split("_")[0]


def _split(
    takes: Sequence[Take], fold: int, group_of: Callable[[str], str]
) -> tuple[list[Take], list[Take]]:
    groups = sorted({group_of(take.name) for take in takes})
    out = set(groups[fold::FOLDS])
    return (
        [take for take in takes if group_of(take.name) not in out],
        [take for take in takes if group_of(take.name) in out],
    )


def _poses(takes: Sequence[Take]) -> FloatArray:
    rate = ObservationSettings.rate_hz
    poses: FloatArray = np.concatenate([resample(take, rate).xyz for take in takes])
    return poses


def _mean(scores: Sequence[LimitsScore]) -> LimitsScore:
    return LimitsScore(
        scores[0].bones,
        mean_over([s.valid for s in scores]),
        mean_over([s.refused for s in scores]),
    )
