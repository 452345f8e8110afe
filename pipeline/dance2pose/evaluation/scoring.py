"""One lifted scene as numbers, and many scenes as one row.

The rule of averaging, everywhere: over the frames of a scene, then over the scenes of a take,
then over takes, so that a long take counts no more than a short one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.evaluation import metrics
from dance2pose.evaluation.cameras import Scene
from dance2pose.evaluation.lifters import LifterEntry
from dance2pose.limits import model as limits
from dance2pose.poses import FloatArray
from dance2pose.progress import Progress


@dataclass(frozen=True)
class Scores:
    """What is measured of lifted scenes, all arrays, NaN where unknown.

    pa, pa_reflected: (J,) mm, error of each joint after Procrustes alignment without and with
    reflection. The rest are single numbers. mpjpe: mm, in the camera's axes, first joints
    together. acceleration: mm/s², error. jerk: mm/s³, and true_jerk that of the truth. lag:
    frames. valid: share of bones within the limits. bone_range: mm by which a bone's length
    changes, of the bone that changes most. within_1, within_2: shares of errors within one and
    two sigma. lifted: share of frames lifted. flexion: degrees, mean error of how far knees and
    elbows are bent; straightness: degrees by which those that are straight seem bent, on average.
    """

    pa: FloatArray
    pa_reflected: FloatArray
    mpjpe: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    true_jerk: FloatArray
    lag: FloatArray
    valid: FloatArray
    bone_range: FloatArray
    within_1: FloatArray
    within_2: FloatArray
    lifted: FloatArray
    flexion: FloatArray
    straightness: FloatArray

    @property
    def pa_mean(self) -> float:
        """PA-MPJPE without reflection over all joints, mm."""
        return float(self.pa.mean())


def score(scene: Scene, xyz: FloatArray, sigma: FloatArray | None = None) -> Scores:
    """Measure poses (T, J, 3) mm of a scene, given in the camera's axes."""
    tree = skeletons.get(scene.skeleton)
    rows = metrics.lifted(xyz)
    estimate = xyz - xyz[:, :1]
    errors = metrics.joint_errors(estimate, scene.truth)
    pa, pa_reflected = metrics.pa_errors_both_ways(xyz, scene.truth)
    # The first joint is the origin of both: it has no error and says nothing of sigma.
    inside = (
        (np.nan, np.nan) if sigma is None else metrics.within_sigma(errors[:, 1:], sigma[:, 1:])
    )
    flexion, straightness = metrics.flexion_errors(xyz, scene.truth, scene.skeleton)
    flags = limits.load(scene.skeleton).is_valid(xyz[rows])
    return Scores(
        pa=metrics.mean_over(pa),
        pa_reflected=metrics.mean_over(pa_reflected),
        mpjpe=np.array(metrics.mean_over(errors).mean()),
        acceleration=np.array(metrics.acceleration_error(estimate, scene.truth, scene.rate_hz)),
        jerk=np.array(metrics.jerk(estimate, scene.rate_hz)),
        true_jerk=np.array(metrics.jerk(scene.truth, scene.rate_hz)),
        lag=np.array(metrics.lag_frames(estimate, scene.truth)),
        valid=np.array(flags.mean() if len(flags) else np.nan),
        bone_range=np.array(metrics.bone_length_range(xyz, tree)),
        within_1=np.array(inside[0]),
        within_2=np.array(inside[1]),
        lifted=np.array(rows.mean()),
        flexion=np.array(flexion),
        straightness=np.array(straightness),
    )


def average(scores: Sequence[tuple[str, Scores]]) -> Scores:
    """Scores of scenes, each with the name of its take, by the rule of averaging."""
    takes = list(dict.fromkeys(take for take, _ in scores))
    return _mean([_mean([s for name, s in scores if name == take]) for take in takes])


def by_take(scores: Sequence[tuple[str, Scores]]) -> dict[str, Scores]:
    """The average of each take's scenes."""
    takes = dict.fromkeys(take for take, _ in scores)
    return {take: _mean([s for name, s in scores if name == take]) for take in takes}


def _mean(scores: Sequence[Scores]) -> Scores:
    return Scores(
        **{
            field.name: metrics.mean_over(np.stack([getattr(s, field.name) for s in scores]))
            for field in fields(Scores)
        }
    )


@dataclass(frozen=True)
class Run:
    """One lifter over many scenes. scores: of each, with the name of its take."""

    scores: list[tuple[str, Scores]]
    frames_per_s: float

    @property
    def mean(self) -> Scores:
        """By the rule of averaging."""
        return average(self.scores)


def lift_scenes(
    entry: LifterEntry, scenes: Sequence[Scene], progress: Progress, what: str
) -> Iterator[tuple[Scene, FloatArray, FloatArray | None, float]]:
    """Each scene with its lifted poses (T, J, 3), their sigma (T, J), and the seconds it took."""
    for scene in progress.track(scenes, f"{what}: {entry.name}", total=len(scenes), unit="scene"):
        observed = scene.observed(independent=entry.independent)
        start = time.perf_counter()
        found = entry.lift(observed)
        yield scene, found.xyz, found.sigma, time.perf_counter() - start


def run(
    entry: LifterEntry,
    scenes: Sequence[Scene],
    truths: Sequence[Scene],
    progress: Progress,
    what: str,
) -> Run:
    """Lift scenes and measure them against `truths` (the same scenes before noise)."""
    scores, seconds = [], 0.0
    lifted = lift_scenes(entry, scenes, progress, what)
    for (scene, xyz, sigma, took), truth in zip(lifted, truths, strict=True):
        scores.append((scene.take, score(replace(truth, xy=scene.xy), xyz, sigma)))
        seconds += took
    return Run(scores, sum(len(s.xy) for s in scenes) / max(seconds, 1e-9))


Perturbation = Callable[[Scene, np.random.Generator], Scene]


def perturbed(scenes: Sequence[Scene], change: Perturbation, seed: int) -> list[Scene]:
    """Every scene changed, each with random numbers of its own that depend on the seed alone."""
    return [
        change(scene, np.random.default_rng((seed, number))) for number, scene in enumerate(scenes)
    ]
