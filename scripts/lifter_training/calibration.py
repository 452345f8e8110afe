"""The lifter's standard deviations fitted to its errors on takes that it was not trained on.

Takes stand on their performers' bones and on drawn ones, before perspective and orthographic
cameras, with keypoints spoiled in every way that `dance2pose evaluate` knows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dance2pose.evaluation.own_bodies import camera_scenes, on_drawn_bodies, spoilings
from dance2pose.evaluation.scoring import perturbed
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.lifting.error_calibration import Calibration, ErrorParts
from dance2pose.lifting.temporal.sequence import lift_frames
from dance2pose.mocap.corpus import Take
from dance2pose.poses import FloatArray

# Of a normal distribution 0.68 and 0.95; a little wide within one sigma, since errors have longer
# tails: then both hold about as often as they should.
_WITHIN_1, _WITHIN_2 = 0.70, 0.95
_NOISE = (0.5, 0.7, 1.0, 1.4)
_BIAS = (2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
_ROUNDS = 4


@dataclass(frozen=True)
class Case:
    """One scene lifted. group: its body, camera and condition. errors: (N, J) mm."""

    group: str
    pictures: bool
    errors: FloatArray
    parts: ErrorParts


def cases(takes: Sequence[Take], frames: int, seed: int) -> Iterator[Case]:
    """Every take, cut to `frames` at 30 a second, under every condition. takes: with their
    performers' bones."""
    short = [_cut(take, frames) for take in takes]
    settings = EvaluationSettings(views=1, seed=seed)
    for body, on in (("own", short), ("drawn", on_drawn_bodies(short, seed))):
        for camera, seen in camera_scenes(on, settings).items():
            for way in spoilings(settings):
                group = f"{body} bodies, {camera}, {way.name}"
                for scene, spoiled in zip(seen, perturbed(seen, way.change, seed), strict=True):
                    lifted = lift_frames(spoiled.observed(independent=way.independent))
                    assert lifted.errors is not None
                    off = lifted.xyz - lifted.xyz[:, :1] - scene.truth
                    distance = np.linalg.norm(off, axis=-1)
                    yield Case(group, way.independent, distance, lifted.errors)


def _cut(take: Take, frames: int) -> Take:
    kept = int(frames * take.rate_hz / 30.0)
    root = None if take.root is None else take.root[:kept]
    return replace(take, xyz=take.xyz[:kept], root=root)


def fitted(found: Sequence[Case]) -> Calibration:
    """The factors with which about as many errors as should lie within one and two sigma, in every
    group of cases alike."""
    candidates = (
        _with_joints(found, Calibration(noise=noise, bias=bias))
        for noise, bias in product(_NOISE, _BIAS)
    )
    return min(candidates, key=lambda c: _unfairness(found, c))


def _with_joints(found: Sequence[Case], start: Calibration) -> Calibration:
    """Factors of each joint that make its errors lie within one sigma as often as they should."""
    now = start
    for _ in range(_ROUNDS):
        ratio = np.concatenate([case.errors / now.sigma(case.parts) for case in found])
        joints = np.array(now.joints) * np.nanquantile(ratio, _WITHIN_1, axis=0)
        joints[0] = joints[1:].min()  # the origin, which has no error to learn from
        now = replace(now, joints=tuple(round(float(j), 4) for j in joints))
    return now


def _unfairness(found: Sequence[Case], calibration: Calibration) -> float:
    off = [(one - _WITHIN_1, two - _WITHIN_2) for one, two in shares(found, calibration).values()]
    return float(np.square(off).sum())


def shares(found: Sequence[Case], calibration: Calibration) -> dict[str, tuple[float, float]]:
    """Of every group, the shares of errors within one and two sigma."""
    out = {}
    for group in dict.fromkeys(case.group for case in found):
        ratio = np.concatenate(
            [
                (case.errors / calibration.sigma(case.parts))[:, 1:].ravel()
                for case in found
                if case.group == group
            ]
        )
        ratio = ratio[np.isfinite(ratio)]
        out[group] = (float((ratio <= 1).mean()), float((ratio <= 2).mean()))
    return out
