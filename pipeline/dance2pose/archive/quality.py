"""How far a result can be trusted, so that people look where they must.

Nothing here knows the truth: every measure is a sign. How well the verdict tells good from bad
results is measured by `scripts/measure_verdict.py` and stated in docs/archive.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from dance2pose.errors import UsageError
from dance2pose.findings import SUDDEN_TURN_DEG, turns_deg
from dance2pose.poses import FloatArray, Track2D, Track3D
from dance2pose.results import Result

Verdict = Literal["good", "review", "poor"]

# Frames further apart than this do not follow one another, s.
_NEXT_S = 0.2
# A person whose centre moves by more than this part of the height in a frame is another one.
_JUMP = 0.5


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Signs of quality of one item, over all its dancers; None where nothing can be said.

    pose_share: part of the frames with a pose. confidence: mean of the keypoints'. filled_share:
    part of the poses that was interpolated. reprojection: median reprojection error as part of
    the person's height in the picture. invalid_bones: part outside the joint-angle limits.
    jitter: median distance of a joint from the middle of the frames beside it, body heights.
    sudden_turns: frames with a bone that turned further than bodies do
    (`findings.SUDDEN_TURN_DEG`), per 1,000 frames.
    switches: jumps of a person in the picture, as where two were taken for one another, per
    1,000 frames. cuts: changes of shot. person_px: median height of the person in the picture.
    sigma: median standard deviation of a joint that the lifter states, body heights.
    """

    dancers: int
    frames: int
    pose_share: float
    confidence: float | None
    filled_share: float
    reprojection: float | None
    invalid_bones: float | None
    jitter: float | None
    sudden_turns: float
    switches: float
    cuts: int
    person_px: float | None
    sigma: float | None


@dataclass(frozen=True, kw_only=True)
class QualityLimits:
    """Where a measure makes a verdict `review`, and where `poor`.

    Chosen by reason and not fitted to anything; docs/archive.md tells how well they serve.
    """

    review_pose_share: float = 0.9
    """Part of the frames with a pose, below which a result is to be reviewed."""
    poor_pose_share: float = 0.5
    """The same, below which it is poor."""
    review_confidence: float = 0.5
    """Mean confidence of the keypoints, below which a result is to be reviewed."""
    poor_confidence: float = 0.3
    """The same, below which it is poor."""
    review_reprojection: float = 0.02
    """Reprojection error in person heights, above which a result is to be reviewed."""
    poor_reprojection: float = 0.06
    """The same, above which it is poor."""
    review_invalid_bones: float = 0.1
    """Part of bones outside the joint-angle limits, above which a result is to be reviewed."""
    poor_invalid_bones: float = 0.3
    """The same, above which it is poor."""
    review_jitter: float = 0.01
    """Jitter in body heights, above which a result is to be reviewed."""
    poor_jitter: float = 0.03
    """The same, above which it is poor."""
    review_turns: float = 5.0
    """Sudden turns per 1,000 frames, above which a result is to be reviewed."""
    poor_turns: float = 50.0
    """The same, above which it is poor."""
    review_switches: float = 2.0
    """Jumps of a person per 1,000 frames, above which a result is to be reviewed."""
    poor_switches: float = 20.0
    """The same, above which it is poor."""
    review_person_px: float = 120.0
    """Height of the person in pixels, below which a result is to be reviewed."""
    poor_person_px: float = 50.0
    """The same, below which it is poor."""
    review_sigma: float = 0.06
    """Standard deviation of a joint in body heights, above which a result is to be reviewed."""
    poor_sigma: float = 0.12
    """The same, above which it is poor."""

    def __post_init__(self) -> None:
        for check in _CHECKS:
            review, poor = check.limits(self)
            if not (math.isfinite(review) and math.isfinite(poor)):
                raise UsageError(f"review-{check.option}, poor-{check.option}: not a number")
            if (poor > review) if check.low_is_bad else (poor < review):
                order = "at most" if check.low_is_bad else "at least"
                raise UsageError(
                    f"poor-{check.option} {poor}: expected {order} review-{check.option} {review}"
                )


@dataclass(frozen=True)
class _Check:
    """A measure, its limits' name, what it is called, and in which direction it is bad."""

    measure: str
    limit: str
    words: str
    low_is_bad: bool = False
    form: str = "{:.1%}"

    @property
    def option(self) -> str:
        return self.limit.replace("_", "-")

    def limits(self, limits: QualityLimits) -> tuple[float, float]:
        return getattr(limits, f"review_{self.limit}"), getattr(limits, f"poor_{self.limit}")

    def judge(self, value: float, limits: QualityLimits) -> tuple[Verdict, str]:
        """The verdict by this measure alone, and the reason for a person."""
        sign = -1 if self.low_is_bad else 1
        review, poor = self.limits(limits)
        found: Verdict = (
            "poor"
            if sign * value > sign * poor
            else "review"
            if sign * value > sign * review
            else "good"
        )
        limit = self.form.format(poor if found == "poor" else review)
        side = "below" if self.low_is_bad else "above"
        return found, f"{self.words} {self.form.format(value)}, {side} {limit}"


_CHECKS = (
    _Check("pose_share", "pose_share", "frames with a pose", low_is_bad=True),
    _Check("confidence", "confidence", "keypoint confidence", low_is_bad=True, form="{:.2f}"),
    _Check("reprojection", "reprojection", "reprojection error in person heights"),
    _Check("invalid_bones", "invalid_bones", "bones outside the joint-angle limits"),
    _Check("jitter", "jitter", "jitter in body heights"),
    _Check("sudden_turns", "turns", "sudden turns per 1,000 frames", form="{:.1f}"),
    _Check("switches", "switches", "jumps of a person per 1,000 frames", form="{:.1f}"),
    _Check("person_px", "person_px", "height of the person in px", low_is_bad=True, form="{:.0f}"),
    _Check("sigma", "sigma", "expected error of a joint in body heights"),
)


@dataclass(frozen=True)
class Quality:
    """Measures, the verdict over them, a reason for each measure that is not good, and what the
    reconstruction itself found to say."""

    measures: Measures
    verdict: Verdict
    reasons: tuple[str, ...]
    findings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As it stands in quality.json and in the ledger."""
        return {
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "findings": list(self.findings),
            **dataclasses.asdict(self.measures),
        }


def judge(measures: Measures, limits: QualityLimits | None = None) -> Quality:
    """The verdict: the worst of what the measures say one by one."""
    found: dict[Verdict, list[str]] = {"poor": [], "review": [], "good": []}
    for check in _CHECKS:
        value = getattr(measures, check.measure)
        if value is not None:
            verdict, reason = check.judge(value, limits or QualityLimits())
            found[verdict].append(reason)
    worst: Verdict = "poor" if found["poor"] else "review" if found["review"] else "good"
    return Quality(measures, worst, (*found["poor"], *found["review"]))


def assess(
    result: Result, limits: QualityLimits | None = None, *, body_height_m: float | None = None
) -> Quality:
    """The quality of what came of a video."""
    measures = measure(
        [dancer.keypoints for dancer in result.dancers],
        [dancer.smoothed for dancer in result.dancers],
        frames=len(result.source.timeline),
        shots=len(result.shots),
        body_height_m=body_height_m,
    )
    return dataclasses.replace(judge(measures, limits), findings=result.findings)


def measure(
    keypoints: Sequence[Track2D],
    poses: Sequence[Track3D],
    *,
    frames: int,
    shots: int = 1,
    body_height_m: float | None = None,
) -> Measures:
    """Measure a result.

    keypoints, poses: of the same dancers in the same order. frames: processed in all. shots: in
    the video. body_height_m: of poses in metres; 1.7 where nobody said.
    """
    heights = [_person_heights(track) for track in keypoints]
    scales = [1.0 if p.unit == "body heights" else (body_height_m or 1.7) for p in poses]
    rows = max(1, sum(len(track) for track in keypoints))
    seen = {
        int(frame)
        for track in keypoints
        for frame in track.frame[~np.isnan(track.xy).all(axis=(1, 2))]
    }
    relative = [p.reprojection_error / h[:, None] for p, h in zip(poses, heights, strict=True)]
    lifted = [p.valid[~np.isnan(p.xyz).all(axis=(1, 2))].ravel() for p in poses]
    sigma = [p.sigma / s for p, s in zip(poses, scales, strict=True) if p.sigma is not None]
    confident = [t.confidence[~np.isnan(t.xy).any(axis=2)] for t in keypoints]
    return Measures(
        dancers=len(keypoints),
        frames=frames,
        pose_share=len(seen) / frames if frames else 0.0,
        confidence=_over(np.mean, confident),
        filled_share=sum(int(t.interpolated.sum()) for t in keypoints) / rows,
        reprojection=_over(np.median, relative),
        invalid_bones=None if (valid := _over(np.mean, lifted)) is None else 1 - valid,
        jitter=_over(np.median, [_jitter(p) / s for p, s in zip(poses, scales, strict=True)]),
        sudden_turns=1000 * sum(map(_sudden_turns, poses)) / rows,
        switches=1000 * sum(map(_jumps, keypoints, heights)) / rows,
        cuts=max(0, shots - 1),
        person_px=_over(np.median, heights),
        sigma=_over(np.median, sigma),
    )


def _over(statistic: Any, parts: Sequence[npt.NDArray[Any]]) -> float | None:
    """A statistic over the finite values of all parts together; None where there are none."""
    values = np.concatenate([np.asarray(p, float).ravel() for p in parts] or [np.empty(0)])
    values = values[np.isfinite(values)]
    return float(statistic(values)) if values.size else None


def _person_heights(track: Track2D) -> npt.NDArray[np.float64]:
    """(T,) the extent of the keypoints from top to bottom, px; NaN where fewer than two."""
    y = track.xy[..., 1].astype(float)
    known = ~np.isnan(y)
    high = np.where(known, y, -np.inf).max(axis=1)
    low = np.where(known, y, np.inf).min(axis=1)
    return np.where((known.sum(axis=1) >= 2) & (high > low), high - low, np.nan)


def _follows(time_s: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """(T - 1,) whether the next frame follows closely."""
    return np.asarray(np.diff(time_s) <= _NEXT_S)


def _jitter(pose: Track3D) -> npt.NDArray[np.float64]:
    """(n,) distances of joints from the middle of their places in the frames beside."""
    if len(pose) < 3:
        return np.empty(0)
    xyz = pose.xyz.astype(float)
    off = np.linalg.norm(xyz[1:-1] - (xyz[:-2] + xyz[2:]) / 2, axis=2)
    follows = _follows(pose.time_s)
    return np.asarray(off[follows[:-1] & follows[1:]].ravel())


def _sudden_turns(pose: Track3D) -> int:
    """In how many frames a bone turned further than bodies do."""
    turns = turns_deg(pose.xyz, pose.timeline, pose.skeleton)
    return int((np.nan_to_num(turns) > SUDDEN_TURN_DEG).any(axis=1).sum())


def _jumps(track: Track2D, heights: FloatArray) -> int:
    """How often the person is somewhere else than one frame before."""
    known = ~np.isnan(track.xy).any(axis=2, keepdims=True)
    count = known.sum(axis=1)
    total = np.where(known, track.xy, 0).sum(axis=1)
    centre = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    moved = np.linalg.norm(np.diff(centre, axis=0), axis=1) / heights[1:]
    return int((moved[_follows(track.time_s)] > _JUMP).sum())
