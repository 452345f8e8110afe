"""How well the verdict of a batch tells good results from bad ones, on motion capture.

    python scripts/measure_verdict.py TAKES [--takes 12] [-o TABLE.csv]

Every take is seen by one camera; its keypoints are degraded as detectors degrade them (noise,
slow drift of whole limbs, missing keypoints, left and right exchanged, and mixtures), lifted by
the default lifter, and judged. The true error is PA-MPJPE. Confidence follows the degradation
only as far as a detector's would: it falls where keypoints are missing or noisy.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import rankdata

from dance2pose.archive.quality import Quality, judge, measure
from dance2pose.evaluation.cameras import Scene, scenes, with_missing, with_noise
from dance2pose.evaluation.metrics import pa_errors
from dance2pose.lifting import lift_all
from dance2pose.mocap.corpus import read_takes
from dance2pose.options import LiftOptions
from dance2pose.poses import Track2D
from dance2pose.skeleton import get

Change = Callable[[Scene, np.random.Generator], tuple[Scene, float]]
"""A degraded scene, and the confidence that a detector would give."""

# An error above this is a result that nobody should use unseen, mm of PA-MPJPE.
BAD_MM = 90.0
# Of every take, at 30 frames a second.
FRAMES = 180


def degradations() -> dict[str, Change]:
    """What can be the matter with keypoints, by name."""

    def seen_as(confidence: float, change: Callable[..., Scene], **how: float) -> Change:
        return lambda scene, rng: (change(scene, rng, **how), confidence)

    return {
        "as it is": lambda scene, rng: (scene, 0.9),
        **{
            f"noise {sigma} mm": seen_as(0.9 - 0.005 * sigma, with_noise, sigma_mm=sigma)
            for sigma in (10, 25, 50, 100)
        },
        **{f"missing {s:.0%}": seen_as(0.85, with_missing, share=s) for s in (0.2, 0.5)},
        **{f"sides exchanged {s:.0%}": seen_as(0.85, exchanged, share=s) for s in (0.1, 0.4)},
        "limbs that drift 150 mm": seen_as(0.7, drifting, sigma_mm=150.0),
        "seen half of the time": seen_as(0.85, unseen),
    }


def exchanged(scene: Scene, rng: np.random.Generator, share: float) -> Scene:
    """Left and right exchanged in runs of 5 to 20 frames."""
    xy = scene.xy.copy()
    mirror = list(get(scene.skeleton).mirror)
    frame = 0
    while frame < len(xy):
        run = int(rng.integers(5, 21))
        if rng.random() < share:
            xy[frame : frame + run] = xy[frame : frame + run][:, mirror]
        frame += run
    return replace(scene, xy=xy)


def drifting(scene: Scene, rng: np.random.Generator, sigma_mm: float) -> Scene:
    """Every joint with an error of its own that changes slowly."""
    frames, joints = scene.xy.shape[:2]
    knots = rng.normal(0, sigma_mm, (frames // 30 + 2, joints, 2))
    places = np.arange(frames) / 30
    low = places.astype(int)
    part = (places - low)[:, None, None]
    return replace(scene, xy=scene.xy + knots[low] * (1 - part) + knots[low + 1] * part)


def unseen(scene: Scene, rng: np.random.Generator) -> Scene:
    """Nobody is seen in half of the frames, in runs of a second."""
    xy = scene.xy.copy()
    for start in range(0, len(xy), 60):
        xy[start : start + 30] = np.nan
    return replace(scene, xy=xy)


def judged(scene: Scene, change: Change, seed: int) -> tuple[Quality, float]:
    """The quality of a degraded scene, and the true error of its poses in mm."""
    rng = np.random.default_rng(seed)
    changed, confidence = change(scene, rng)
    observed = changed.observed()
    pixels = observed.xy * np.array([1.0, -1.0])
    track = Track2D.from_arrays(
        pixels,
        confidence=np.where(np.isnan(pixels).any(axis=2), 0.0, confidence),
        time_s=observed.time_s,
        skeleton=scene.skeleton,
        image_size=observed.image_size,
    )
    (poses,) = lift_all([track], LiftOptions(camera="weak-perspective"))
    found = ~np.isnan(poses.xyz).any(axis=(1, 2))
    errors = pa_errors(poses.xyz[found], scene.truth[found])
    quality = judge(measure([track], [poses], frames=len(track)))
    return quality, float(np.mean(errors))


def area_under_curve(scores: list[int], bad: list[bool]) -> float:
    """The probability that a bad result has a worse verdict than a good one (ties count half)."""
    ranks, flags = rankdata(scores), np.array(bad)
    positive, negative = int(flags.sum()), int((~flags).sum())
    if not positive or not negative:
        return float("nan")
    return float((ranks[flags].sum() - positive * (positive + 1) / 2) / (positive * negative))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("takes", type=Path)
    parser.add_argument("--takes", type=int, default=12, dest="count")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("-o", "--output", type=Path)
    arguments = parser.parse_args()
    takes = list(read_takes(arguments.takes, "body17"))
    step = max(1, len(takes) // arguments.count)
    chosen = scenes(
        takes[::step][: arguments.count], views=1, tilt_deg=10, seed=arguments.seed, rate_hz=30
    )
    rows = []
    for number, scene in enumerate(chosen):
        short = replace(scene, truth=scene.truth[:FRAMES], xy=scene.xy[:FRAMES])
        for name, change in degradations().items():
            quality, error = judged(short, change, arguments.seed + number)
            rows.append((scene.take, name, quality, error))
            print(f"{scene.take}, {name}: {quality.verdict}, {error:.0f} mm", file=sys.stderr)
    report(rows)
    if arguments.output:
        write(arguments.output, rows)


def report(rows: list[tuple[str, str, Quality, float]]) -> None:
    """Print what the verdicts were worth."""
    order = {"good": 0, "review": 1, "poor": 2}
    for verdict in order:
        errors = [error for _, _, quality, error in rows if quality.verdict == verdict]
        if errors:
            bad = np.mean([error > BAD_MM for error in errors])
            print(
                f"{verdict}: {len(errors)} results, PA-MPJPE median {np.median(errors):.0f} mm, "
                f"90 % below {np.quantile(errors, 0.9):.0f} mm, {bad:.0%} above {BAD_MM:.0f} mm"
            )
    scores = [order[quality.verdict] for _, _, quality, _ in rows]
    curve = area_under_curve(scores, [error > BAD_MM for *_, error in rows])
    print(f"area under the curve for an error above {BAD_MM:.0f} mm: {curve:.2f}")


def write(path: Path, rows: list[tuple[str, str, Quality, float]]) -> None:
    """The table behind it."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["take", "degradation", "verdict", "pa_mpjpe_mm", "reasons"])
        for take, name, quality, error in rows:
            reasons = "; ".join(quality.reasons)
            writer.writerow([take, name, quality.verdict, f"{error:.1f}", reasons])


if __name__ == "__main__":
    main()
