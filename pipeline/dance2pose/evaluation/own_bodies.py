"""The default lifter on bodies that it does not know: performers' own, and drawn ones.

All have the same sum of bone lengths, so that mm compare with those on the one body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dance2pose.body import retarget
from dance2pose.evaluation.cameras import (
    Scene,
    scenes,
    with_missing,
    with_noise,
    with_slow_errors,
)
from dance2pose.evaluation.lifters import DEFAULT, LifterEntry
from dance2pose.evaluation.metrics import STRAIGHT_DEG
from dance2pose.evaluation.perspective_scenes import (
    FOV_DEG,
    HIGHEST_MM,
    LOWEST_MM,
    NEAREST_MM,
    perspective_scenes,
)
from dance2pose.evaluation.scoring import Run, Scores, average, by_take, perturbed, run
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.mocap.bodies import drawn_bodies
from dance2pose.mocap.corpus import Take
from dance2pose.progress import Progress
from dance2pose.skeleton import get

# Keypoint models err alike for as long as a pose looks alike: slow errors of this size and
# duration, and white ones beside them.
SLOW_MM, SLOW_CORRELATION_S, BESIDE_SLOW_MM = 15.0, 1.0, 5.0


# What the tables are about, for the report.
DESCRIPTION = (
    "Each take on the bones of its performer (the poser rig's differ most: a trunk of 1.35 times "
    "the one body's length, hips 0.63), or of a body drawn from human variation (`mocap.bodies`); "
    "all bodies have the one body's sum of bone lengths, so that mm compare. Perspective: a camera "
    f"{LOWEST_MM / 1000:g} to {HIGHEST_MM / 1000:g} m above the floor, pointed at the middle of "
    f"the dancer's path, at least {NEAREST_MM / 1000:g} m away and far enough to see all of it, "
    f"field of view {FOV_DEG:g}° and known. Slow errors: an Ornstein-Uhlenbeck process of each "
    f"coordinate with a correlation time of {SLOW_CORRELATION_S:g} s. Straight: knees and elbows "
    f"bent by less than {STRAIGHT_DEG:g}°. σ aims at 68 and 95 %."
)


@dataclass(frozen=True)
class Spoiling:
    """How the 2D is spoiled: `change` of a scene. independent: frames given as single pictures."""

    name: str
    change: Callable[[Scene, np.random.Generator], Scene]
    independent: bool = False


def spoilings(settings: EvaluationSettings) -> tuple[Spoiling, ...]:
    """The conditions, the first of which spoils nothing."""

    def unspoiled(scene: Scene, rng: np.random.Generator) -> Scene:
        return scene

    def as_keypoint_models(scene: Scene, rng: np.random.Generator) -> Scene:
        slow = with_slow_errors(scene, rng, sigma_mm=SLOW_MM, correlation_s=SLOW_CORRELATION_S)
        return with_noise(slow, rng, sigma_mm=BESIDE_SLOW_MM)

    return (
        Spoiling("clean", unspoiled),
        Spoiling(
            f"white {settings.noise_mm:g} mm", partial(with_noise, sigma_mm=settings.noise_mm)
        ),
        Spoiling(f"slow {SLOW_MM:g} mm, white {BESIDE_SLOW_MM:g} mm", as_keypoint_models),
        Spoiling(f"{settings.missing:.0%} missing", partial(with_missing, share=settings.missing)),
        Spoiling("single pictures, clean", unspoiled, independent=True),
    )


def on_drawn_bodies(takes: Sequence[Take], seed: int) -> list[Take]:
    """Every take on a body of its own, drawn from human variation."""
    out = []
    for number, take in enumerate(takes):
        rng = np.random.default_rng((seed, number))
        (lengths,) = drawn_bodies(rng, 1, take.skeleton)
        out.append(replace(take, xyz=retarget(take.xyz, get(take.skeleton), lengths)))
    return out


def own_bodies_tables(
    takes: Sequence[Take],
    settings: EvaluationSettings,
    progress: Progress,
    lifter: LifterEntry = DEFAULT,
) -> list[Table]:
    """The lifter on takes read with their performers' bones, and on drawn bodies.

    takes: from `read_takes(..., own_bones=True)`.
    """
    tables = []
    for key, body, on in (
        ("own", "performers' own bodies", takes),
        ("drawn", "bodies drawn from human variation", on_drawn_bodies(takes, settings.seed)),
    ):
        for camera, seen in camera_scenes(on, settings).items():
            runs = run_spoiled(lifter, seen, settings, progress, f"{key} bodies, {camera}")
            title = f"The {lifter.name} lifter on {body}, {camera}"
            tables.append(conditions_table(f"{key}_bodies_{camera}", title, runs, on))
            if (key, camera) == ("own", "perspective"):
                title = "PA-MPJPE of every take on its performer's own body, perspective, mm"
                tables.append(takes_table("own_bodies_takes", title, runs))
    return tables


def camera_scenes(takes: Sequence[Take], settings: EvaluationSettings) -> dict[str, list[Scene]]:
    """The takes as perspective and as orthographic cameras see them."""
    views, seed, rate_hz = settings.views, settings.seed, settings.rate_hz
    flat = scenes(takes, views=views, tilt_deg=settings.tilt_deg, seed=seed, rate_hz=rate_hz)
    return {
        "perspective": perspective_scenes(takes, views=views, seed=seed, rate_hz=rate_hz),
        "orthographic": flat,
    }


def run_spoiled(
    lifter: LifterEntry,
    seen: Sequence[Scene],
    settings: EvaluationSettings,
    progress: Progress,
    what: str,
) -> dict[str, Run]:
    """The lifter under every condition, by its name."""
    return {
        way.name: run(
            replace(lifter, independent=way.independent),
            perturbed(seen, way.change, settings.seed),
            seen,
            progress,
            f"{what}, {way.name}",
        )
        for way in spoilings(settings)
    }


def conditions_table(
    name: str, title: str, runs: Mapping[str, Run], takes: Sequence[Take]
) -> Table:
    """One row a condition: errors, by rig where there are several, sigma and joint angles."""
    rigs = {take.name: take.rig for take in takes}
    kinds = sorted(set(rigs.values()))
    rows: list[list[Cell]] = []
    for condition, found in runs.items():
        row: list[Cell] = [condition, found.mean.pa_mean]
        if len(kinds) > 1:
            row += [_of_rig(found, rigs, kind).pa_mean for kind in kinds]
        rows.append([*row, *_beside(found.mean)])
    header = ["PA-MPJPE, mm", "all takes"]
    if len(kinds) > 1:
        header += [f"{kind or 'positions'} rig" for kind in kinds]
    return Table(name, title, (*header, *_BESIDE), rows)


def _of_rig(found: Run, rigs: Mapping[str, str], rig: str) -> Scores:
    return average([(take, scores) for take, scores in found.scores if rigs[take] == rig])


# Beside PA-MPJPE.
_BESIDE = (
    "MPJPE, mm",
    "within 1 σ, %",
    "within 2 σ, %",
    "knees and elbows, error, degrees",
    "straight ones seem bent by, degrees",
    "bones within the limits, %",
)


def _beside(mean: Scores) -> list[Cell]:
    return [
        float(mean.mpjpe),
        100 * float(mean.within_1),
        100 * float(mean.within_2),
        float(mean.flexion),
        float(mean.straightness),
        100 * float(mean.valid),
    ]


def takes_table(name: str, title: str, runs: Mapping[str, Run]) -> Table:
    """PA-MPJPE of every take under every condition."""
    per_way = {way: by_take(found.scores) for way, found in runs.items()}
    names = list(next(iter(per_way.values())))
    rows: list[list[Cell]] = [
        [take, *(scores[take].pa_mean for scores in per_way.values())] for take in names
    ]
    return Table(name, title, ("take", *per_way), rows)
