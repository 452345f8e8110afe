"""The default lifter: depth from a small temporal network, then one body for the whole track.

The network (`depth`) says for every frame where the joints are and how sure it is. The track then
decides what a single frame cannot (`one_body`): the dancer's bone lengths, how noisy the keypoints
are, how fast joints move. What is nearer looks larger: once poses are found this is undone, the
network is told the bones that were found, and all is found again.

T frames, J joints; x right, y up, z towards the viewer; mm at the size of the one body.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit.paper import keypoint_weights
from dance2pose.lifting.temporal import depth
from dance2pose.lifting.temporal.apparent_size import growth, size_errors, sizes
from dance2pose.lifting.temporal.body_of_track import Found
from dance2pose.lifting.temporal.depth import Depth, Known, predict_frames
from dance2pose.lifting.temporal.keypoint_errors import likely_projections
from dance2pose.lifting.temporal.network import longest_projections
from dance2pose.lifting.temporal.one_body import (
    Posed,
    SequenceSettings,
    nearness,
    pose_one_body,
)
from dance2pose.lifting.temporal.single_pictures import pose_pictures
from dance2pose.lifting.temporal.track_rows import Rows, rows_of, stretches
from dance2pose.lifting.temporal.windows import LONGEST_WHOLE, lift_in_windows
from dance2pose.lifting.world.pointed_view import placed, pointed_at_dancer
from dance2pose.poses import FloatArray

# How often at most the effects of nearness are undone, and the change of size that has none.
_PASSES, _STEADY = 3, 0.04


def lift_frames(observed: Observed, *, settings: SequenceSettings | None = None) -> Lifted:
    """Poses of all frames but those in gaps of more than LONGEST_GAP_S, which stay NaN."""
    weighted = replace(observed, confidence=keypoint_weights(observed.xy, observed.confidence))
    lift = partial(_lift_weighted, settings or SequenceSettings())
    long = len(observed) > LONGEST_WHOLE and not observed.independent
    lifted = lift_in_windows(weighted, lift) if long else lift(weighted)
    depth.give_back_memory()
    return lifted


def _lift_weighted(
    settings: SequenceSettings, observed: Observed, known: Found | None = None
) -> Lifted:
    """Poses of all frames of keypoints whose confidence is their weight."""
    # paper15 is cmu17 without toes and in another order.
    skeleton = "cmu17" if observed.skeleton == "paper15" else observed.skeleton
    xy = np.where(observed.confidence[..., None] > 0, observed.xy, np.nan)
    xy, weights = skeletons.convert(
        xy, observed.confidence, source=observed.skeleton, target=skeleton
    )
    same = replace(observed, xy=xy, confidence=weights, skeleton=skeleton)
    lift = _lift_in_perspective if observed.camera == "perspective" else _lift
    lifted = lift(same, settings, known)
    return lifted if skeleton == observed.skeleton else _converted(lifted, observed.skeleton)


def _converted(lifted: Lifted, target: str) -> Lifted:
    assert lifted.sigma is not None
    together = np.concatenate([lifted.xyz, lifted.projected, lifted.sigma[..., None]], axis=-1)
    confidence = np.ones(together.shape[:2])
    moved = skeletons.convert(together, confidence, source="cmu17", target=target)[0]
    found = moved[..., :3], moved[..., 3:5], moved[..., 5]
    return Lifted(*found, lifted.root, lifted.body, lifted.errors)  # errors stay of cmu17's joints


def _lift(
    observed: Observed,
    settings: SequenceSettings,
    known: Found | None = None,
    *,
    focal_px: float | None = None,
) -> Lifted:
    """Poses under a weak-perspective camera; with a focal length, in px, under a perspective one
    that points at the dancer, so that xy (T, J, 2) is relative to the middle of its picture.

    known: the body and the keypoints' errors, where more of the track has told them."""
    frames, joints = observed.confidence.shape
    xyz = np.full((frames, joints, 3), np.nan)
    projected, sigma = np.full((frames, joints, 2), np.nan), np.full((frames, joints), np.nan)
    rows, seen = rows_of(observed)
    if not len(rows):
        return Lifted(xyz, projected, sigma)
    if observed.independent:
        found = _solve_pictures(seen, settings, focal_px)
    else:
        found = _solve_sequence(seen, settings, focal_px, known)
    pose = found.xyz - found.xyz[:, :1]
    xyz[rows] = pose
    errors = found.errors.on_rows(rows, frames)
    sigma = depth.calibration(pictures=observed.independent).sigma(errors)
    projected[rows] = _drawn(pose, found.px_per_mm, observed.xy[rows])
    body = None if observed.independent else found.found.body
    return Lifted(xyz, projected, sigma, body=body, errors=errors)


def _solve_sequence(
    seen: Rows, settings: SequenceSettings, focal_px: float | None, known: Found | None
) -> Posed:
    """Poses of one dancer: pass by pass, nearness is undone and the body is better known.

    A solve that knows the body begins as one that does not: growth and nearness are then undone
    by the same steps, and a window comes out as it would within the whole track.
    """
    grown = _growth_alone(seen)
    shrink: FloatArray = 1 / grown[:, None, None]
    found: Found | None = None
    unit, steady = 1.0, False
    last, passes = False, 0
    while not last:
        passes += 1
        # Without perspective one pass finds the body, unless the dancer comes near and goes away.
        last = passes == _PASSES or (passes > 1 and focal_px is None and steady)
        level = seen.scaled(shrink)
        answer = _answers(level, found, unit, told=last)
        posed = pose_one_body(answer, level, settings, found, told=last, focal_px=focal_px)
        found, unit = known or posed.found, float(np.median(posed.px_per_mm))
        px_per_mm = posed.px_per_mm * grown
        now = px_per_mm / np.median(px_per_mm)
        steady = float(np.abs(now / grown - 1).max()) < _STEADY
        grown = now
        shrink = 1 / grown[:, None, None]
        if focal_px is not None:
            shrink = shrink * nearness(posed.xyz, px_per_mm, focal_px)
    return replace(posed, px_per_mm=px_per_mm)


def _solve_pictures(seen: Rows, settings: SequenceSettings, focal_px: float | None) -> Posed:
    found = pose_pictures(seen, settings)
    if focal_px is None:
        return found
    for _ in range(_PASSES - 1):
        level = seen.scaled(nearness(found.xyz, found.px_per_mm, focal_px))
        found = pose_pictures(level, settings)
    return found


def _growth_alone(seen: Rows) -> FloatArray:
    """How the figure grows (N,), from what the frames show by themselves.

    Something that knows nothing of the track has to begin: how long a bone ever looked tells
    little where the dancer comes near and goes away.
    """
    answer = predict_frames(seen.xy, seen.confidence, body17=seen.body17)
    size = sizes(answer.xyz, seen.tree, seen.usual_mm) * answer.scale
    return growth(size, size_errors(answer.sigma), seen.parts, seen.time_s)


def _answers(seen: Rows, found: Found | None, unit: float, *, told: bool) -> Depth:
    """The network's answers. told: it is told the bones found, of `unit` px a mm."""
    longest = likely_projections(longest_projections(seen.xy[None])[0], seen.usual_mm)
    if found is not None and told:
        longest = unit * found.body.lengths_mm
    error_mm = found.bias_mm if found is not None else seen.bias_mm or None
    known = Known(longest=longest, lengths=found is not None and told, error_mm=error_mm)
    return depth.joined(
        [
            depth.predict_at(
                seen.xy[part],
                seen.confidence[part],
                seen.time_s[part],
                body17=seen.body17,
                known=known,
            )
            for part in seen.parts
        ]
    )


def _lift_in_perspective(
    observed: Observed, settings: SequenceSettings, known: Found | None = None
) -> Lifted:
    """Poses as a camera pointed at the dancer would see them, turned back, and the path."""
    view = pointed_at_dancer(observed)
    if view is None:
        return _lift(observed, settings, known)
    pointed, focal_px = replace(observed, xy=view.xy), view.camera.focal_px
    lifted = _lift(pointed, settings, known, focal_px=focal_px)
    return placed(view, observed, lifted, [] if observed.independent else stretches(observed))


def _drawn(xyz: FloatArray, scale: FloatArray, xy: FloatArray) -> FloatArray:
    """The poses in the picture (N, J, 2), moved to where the keypoints xy (N, J, 2) were seen."""
    drawn = scale[:, None, None] * xyz[..., :2]
    seen = np.isfinite(xy).all(axis=-1, keepdims=True)
    off = np.where(seen, xy - drawn, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return np.asarray(drawn + off[:, None])
