"""The default lifter: depth from a small temporal network, then one body for the whole track.

The network (`depth`) says for every frame where the joints are and how sure it is. The track then
decides what a single frame cannot: the dancer's bone lengths (`bones`), how noisy the keypoints
are, how fast joints move (`smoothness`). Limits of the joints (`limits`) hold of every pose.

T frames, J joints; x right, y up, z towards the viewer; mm on the one body of `mocap.corpus`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.body import body_bones_mm, retarget
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit.paper import FEWEST_JOINTS, keypoint_weights
from dance2pose.lifting.temporal import depth
from dance2pose.lifting.temporal.apparent_size import SIZE_ERROR, growth, sizes
from dance2pose.lifting.temporal.bones import (
    PRIOR_SPREAD,
    likely_projections,
    track_bone_lengths,
    with_bone_lengths,
)
from dance2pose.lifting.temporal.depth import Depth
from dance2pose.lifting.temporal.depth_signs import settle_depths
from dance2pose.lifting.temporal.network import longest_projections
from dance2pose.lifting.temporal.smoothness import frame_noise, smooth_path
from dance2pose.lifting.world.perspective import camera_of, place, seen_straight, towards
from dance2pose.lifting.world.root_trajectory import follow_floor
from dance2pose.limits import model as limits
from dance2pose.poses import FloatArray, IntArray

# A dancer who is out of sight for longer than this is not guessed at.
LONGEST_GAP_S = 0.5
# The network's errors of depth, by how much of them changes from one frame to the next and how
# much stays: only the first can be smoothed away.
_FLICKER = 0.25
_LEAST_NOISE_MM = 1.0
# How often at most the effects of nearness are undone, and the change of size that has none.
_PASSES, _STEADY = 3, 0.04
# How far a bone of the wrong length is stretched rather than turned: as a part of the error of its
# depth. Turning alone makes bones that lie about across the view flicker.
_RADIAL = 0.7
# The network's error across the view, as a part of that of the position.
_ACROSS = 1.3
# Keypoint models err alike for as long as a pose and a costume look alike, mm in either direction
# of the picture: no jitter tells, no average mends. (People who mark joints scatter by 20 to 60
# mm.) The joints of the other skeletons come from motion capture.
_KEYPOINT_BIAS_MM = {"body17": 20.0}
# What such errors make of a joint in space, as a multiple: two of the three directions, and the
# depths that follow from them (measured on held-out takes with slow errors of 15 mm).
_BIAS_IN_SPACE = 2.5
# Beside this length, noise of the keypoints says how much bones seem to vary in length.
_TYPICAL_BONE_MM = 400.0


@dataclass(frozen=True)
class SequenceSettings:
    """What is done to the network's answer; each can be switched off to see what it brings.

    flips: which end of a bone is nearer, settled by the whole track. smooth: paths without
    jitter. bones: constant bone lengths. limits: joint-angle limits.
    """

    flips: bool = True
    smooth: bool = True
    bones: bool = True
    limits: bool = True


def lift_frames(observed: Observed, *, settings: SequenceSettings | None = None) -> Lifted:
    """Poses of all frames but those in gaps of more than LONGEST_GAP_S, which stay NaN."""
    # paper15 is cmu17 without toes and in another order.
    skeleton = "cmu17" if observed.skeleton == "paper15" else observed.skeleton
    weights = keypoint_weights(observed.xy, observed.confidence)
    xy = np.where(weights[..., None] > 0, observed.xy, np.nan)
    xy, weights = skeletons.convert(xy, weights, source=observed.skeleton, target=skeleton)
    same = replace(observed, xy=xy, confidence=weights, skeleton=skeleton)
    find = _lift_in_perspective if observed.camera == "perspective" else _lift
    lifted = find(same, settings or SequenceSettings())
    return lifted if skeleton == observed.skeleton else _converted(lifted, observed.skeleton)


def _converted(lifted: Lifted, target: str) -> Lifted:
    assert lifted.sigma is not None
    together = np.concatenate([lifted.xyz, lifted.projected, lifted.sigma[..., None]], axis=-1)
    confidence = np.ones(together.shape[:2])
    moved = skeletons.convert(together, confidence, source="cmu17", target=target)[0]
    return Lifted(moved[..., :3], moved[..., 3:5], moved[..., 5], lifted.root)


def _lift(
    observed: Observed, settings: SequenceSettings, *, focal_px: float | None = None
) -> Lifted:
    """Poses under a weak-perspective camera; with a focal length, in px, under a perspective one
    that points at the dancer, so that xy (T, J, 2) is relative to the middle of its picture."""
    frames, joints = observed.confidence.shape
    xyz = np.full((frames, joints, 3), np.nan)
    projected, sigma = np.full((frames, joints, 2), np.nan), np.full((frames, joints), np.nan)
    stretches = _stretches(observed)
    if stretches:
        rows = np.concatenate(stretches)
        found, spread, size = _solved(observed, stretches, settings, focal_px)
        found -= found[:, :1]
        if settings.limits:
            found = limits.load(observed.skeleton).project_to_valid(found)
        bias = _BIAS_IN_SPACE * _KEYPOINT_BIAS_MM.get(observed.skeleton, 0.0)
        xyz[rows], sigma[rows] = found, np.hypot(spread * depth.sigma_factors(), bias)
        projected[rows] = _drawn(found, size, observed.xy[rows])
    return Lifted(xyz, projected, sigma)


def _solved(
    observed: Observed,
    stretches: list[IntArray],
    settings: SequenceSettings,
    focal_px: float | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses, scale of their errors and px a mm, in the rows of all stretches.

    What is nearer looks larger: the whole figure when the dancer comes closer, and with a known
    focal length each joint. Once poses are found this is undone, and all is found again.
    """
    rows = np.concatenate(stretches)
    level: Observed = observed
    grown: FloatArray = np.ones(len(rows))
    if not observed.independent:
        grown = _growth_alone(observed, stretches)
        level = _shrunk(observed, rows, 1 / grown[:, None, None])
    for step in range(_PASSES):
        answer = _answers(level, stretches)
        steady = focal_px is None and float(np.ptp(grown)) < _STEADY
        found, spread, size = _one_body(answer, level, stretches, settings, steady=steady)
        size = size * grown
        now = size / np.median(size) if not observed.independent else np.ones(len(rows))
        if step == _PASSES - 1 or (focal_px is None and np.abs(now / grown - 1).max() < _STEADY):
            break
        grown = now
        shrink = 1 / grown[:, None, None]
        if focal_px is not None:
            nearer = found[..., 2:] - found[:, :1, 2:]
            shrink = shrink * np.clip(1 - nearer * (size / focal_px)[:, None, None], 0.5, 1.5)
        level = _shrunk(observed, rows, shrink)
    return found, spread, size


def _shrunk(observed: Observed, rows: IntArray, factor: FloatArray) -> Observed:
    xy = observed.xy.copy()
    xy[rows] *= factor
    return replace(observed, xy=xy)


def _growth_alone(observed: Observed, stretches: list[IntArray]) -> FloatArray:
    """How the figure grows (N,), from what the frames show by themselves.

    Something that knows nothing of the track has to begin: how long a bone ever looked tells
    little where the dancer comes near and goes away.
    """
    rows = np.concatenate(stretches)
    parts = np.split(np.arange(len(rows)), np.cumsum([len(s) for s in stretches])[:-1])
    tree, body = skeletons.get(observed.skeleton), body_bones_mm(observed.skeleton)
    answer = _answers_alone(observed.xy[rows], observed.confidence[rows], observed.skeleton)
    size = sizes(answer.xyz, tree, body) * answer.scale
    return growth(size, answer.sigma, parts, observed.time_s[rows])


def _lift_in_perspective(observed: Observed, settings: SequenceSettings) -> Lifted:
    """Poses as a camera pointed at the dancer would see them, turned back, and the path."""
    camera = camera_of(observed.image_size, observed.fov_deg)
    direction = camera.rays(_middle(observed))
    known = np.isfinite(direction).all(axis=1)
    if not known.any():
        return _lift(observed, settings)
    times = np.arange(len(observed)) * 1.0 if observed.independent else observed.time_s
    direction = np.stack(
        [np.interp(times, times[known], direction[known, axis]) for axis in range(3)], axis=1
    )
    if not observed.independent:
        direction = smooth_path(direction, np.array(0.02), times, acceleration=1.0)
    turn = towards(direction)
    straight = replace(observed, xy=seen_straight(camera, observed.xy, turn))
    lifted = _lift(straight, settings, focal_px=camera.focal_px)
    xyz = lifted.xyz @ turn  # back from the turned camera
    root = place(camera, xyz, observed.xy, np.clip(observed.confidence, 0.0, 1.0))
    root[~np.isfinite(xyz).all(axis=(1, 2))] = np.nan
    if not observed.independent:
        tree = skeletons.get(observed.skeleton)
        for rows in _stretches(observed):
            if np.isfinite(root[rows]).any():
                root[rows] = follow_floor(xyz[rows], root[rows], observed.time_s[rows], tree)
    return Lifted(xyz, camera.project(xyz + root[:, None]), lifted.sigma, root)


def _middle(observed: Observed) -> FloatArray:
    """The middle (T, 2) of the joints seen, NaN where none is."""
    seen = np.isfinite(observed.xy).all(axis=-1, keepdims=True)
    total = np.where(seen, observed.xy, 0.0).sum(axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / seen.sum(axis=1))


def _stretches(observed: Observed) -> list[IntArray]:
    """Rows between the first and last sight of the dancer, cut where the dancer is long away."""
    enough = np.isfinite(observed.xy).all(axis=-1).sum(axis=1) >= FEWEST_JOINTS
    seen = np.flatnonzero(enough)
    if not len(seen):
        return []
    if observed.independent:
        return [seen]
    cuts = np.flatnonzero(np.diff(observed.time_s[seen]) > LONGEST_GAP_S)
    starts, stops = seen[np.r_[0, cuts + 1]], seen[np.r_[cuts, len(seen) - 1]]
    return [np.arange(a, b + 1) for a, b in zip(starts, stops, strict=True)]


def _answers(observed: Observed, stretches: list[IntArray]) -> Depth:
    xy, confidence, body17 = observed.xy, observed.confidence, observed.skeleton == "body17"
    if observed.independent:
        return _answers_alone(xy[stretches[0]], confidence[stretches[0]], observed.skeleton)
    longest = likely_projections(longest_projections(xy[None])[0], body_bones_mm(observed.skeleton))
    return depth.joined(
        [
            depth.predict_at(
                xy[rows], confidence[rows], observed.time_s[rows], body17=body17, longest=longest
            )
            for rows in stretches
        ]
    )


def _answers_alone(xy: FloatArray, confidence: FloatArray, skeleton: str) -> Depth:
    """Every frame by itself: first as it is; then, once its size is known, as the one body's.

    A single picture does not tell the dancer's proportions; those of the one body are taken, as
    the dictionary of the paper's method does.
    """
    body17, tree = skeleton == "body17", skeletons.get(skeleton)
    body = body_bones_mm(skeleton)
    first = depth.predict_frames(xy, confidence, body17=body17)
    size = sizes(first.xyz, tree, body) * first.scale
    seen = np.isfinite(longest_projections(xy[:, np.newaxis]))
    longest = np.where(seen, size[:, np.newaxis] * body, np.nan)
    return depth.predict_frames(xy, confidence, body17=body17, longest=longest)


def _one_body(
    answer: Depth,
    observed: Observed,
    stretches: list[IntArray],
    settings: SequenceSettings,
    *,
    steady: bool,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses (N, J, 3) of one dancer in the rows of all stretches, the scale (N, J) of their errors
    and px a mm in each (N,). steady: nothing but noise makes its bones seem to grow and shrink."""
    rows = np.concatenate(stretches)
    parts = np.split(np.arange(len(rows)), np.cumsum([len(s) for s in stretches])[:-1])
    tree, body = skeletons.get(observed.skeleton), body_bones_mm(observed.skeleton)
    times: FloatArray = observed.time_s[rows]
    size: FloatArray
    if observed.independent:  # so far apart that nothing flows
        times = 1e3 * np.arange(len(rows))
        size = sizes(answer.xyz, tree, body)
    else:
        looks = sizes(answer.xyz, tree, body) * answer.scale
        size = growth(looks, answer.sigma, parts, times)
    xyz: FloatArray = answer.xyz / size[:, None, None]
    picture = (observed.xy[rows] - answer.centre[:, None]) / (answer.scale * size)[:, None, None]
    sigma: FloatArray = np.stack(
        [answer.sigma * _ACROSS, answer.sigma * _ACROSS, answer.sigma_z], axis=-1
    )
    spot = _spot_noise(picture, observed.confidence[rows], observed.independent)
    xyz, sigma = _seen_and_said(xyz, sigma, picture, spot)
    bias = _KEYPOINT_BIAS_MM.get(observed.skeleton, 0.0)
    smooth = settings.smooth and not observed.independent
    if smooth:
        for part in parts:
            xyz[part, :, :2] = smooth_path(xyz[part, :, :2], sigma[part, :, :2], times[part])
    lengths, spread = body, np.full(len(body), np.hypot(PRIOR_SPREAD, SIZE_ERROR))
    if not observed.independent:
        seen = np.isfinite(picture)
        flat = np.where(seen, xyz[..., :2], np.nan)
        wobble = float(np.hypot(np.median(spot), bias)) / _TYPICAL_BONE_MM
        wobble = float(np.hypot(wobble, 0.0 if steady else SIZE_ERROR))
        lengths, spread = track_bone_lengths(flat, xyz, tree, body, wobble=wobble)
        unit = lengths.sum() / body.sum()
        xyz, sigma, lengths, size = xyz / unit, sigma / unit, lengths / unit, size * unit
    if settings.flips:
        for part in parts:
            xyz[part, :, 2], variance = settle_depths(
                xyz[part],
                sigma[part, :, 2],
                np.hypot(sigma[part, :, 0], bias),
                times[part],
                tree,
                lengths,
                spread=spread,
            )
            sigma[part, :, 2] = np.sqrt(variance)
    if smooth:
        for part in parts:
            flicker = _FLICKER * sigma[part, :, 2:]
            xyz[part, :, 2:] = smooth_path(xyz[part, :, 2:], flicker, times[part])
    if settings.bones:
        give = sigma**2 + 1.0
        give[..., :2] += (_RADIAL * sigma[..., 2:]) ** 2
        xyz = with_bone_lengths(xyz, give, tree, lengths, spread=spread)
        if not observed.independent:
            xyz = retarget(xyz, tree, lengths)
    # What is left after the solution, and what the network feared before: measured, their
    # geometric mean is closer to the errors than either. Noise moves the origin too, the first
    # joint, and with it all others.
    left = np.sqrt(np.square(sigma).sum(axis=-1))
    spread_mm = np.sqrt(left * answer.sigma / size[:, None] + 2 * spot**2)
    return xyz, spread_mm, answer.scale * size


def _spot_noise(picture: FloatArray, confidence: FloatArray, independent: bool) -> FloatArray:
    """Standard deviation (N, J) of where joints were seen, mm, from their jitter over the track."""
    noise: FloatArray = np.full(picture.shape[1], np.nan)
    if not independent:
        noise = frame_noise(picture)
    noise = np.maximum(np.nan_to_num(noise), _LEAST_NOISE_MM)
    return np.asarray(noise / np.clip(confidence, 0.1, 1.0))


def _seen_and_said(
    xyz: FloatArray, sigma: FloatArray, picture: FloatArray, spot: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The network's places drawn to where the joints were seen, by how sure either is."""
    seen = np.asarray(np.isfinite(picture).all(axis=-1))
    across = sigma[..., 0] ** 2
    trust = np.where(seen, across / (across + spot**2), 0.0)[..., None]
    xyz, sigma = xyz.copy(), sigma.copy()
    xyz[..., :2] += trust * (np.where(seen[..., None], picture, 0.0) - xyz[..., :2])
    sigma[..., :2] *= np.sqrt(1 - trust)
    return xyz, sigma


def _drawn(xyz: FloatArray, scale: FloatArray, xy: FloatArray) -> FloatArray:
    """The poses in the picture (N, J, 2), moved to where the keypoints xy (N, J, 2) were seen."""
    drawn = scale[:, None, None] * xyz[..., :2]
    seen = np.isfinite(xy).all(axis=-1, keepdims=True)
    off = np.where(seen, xy - drawn, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return np.asarray(drawn + off[:, None])
