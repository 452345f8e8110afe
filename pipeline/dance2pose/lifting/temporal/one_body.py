"""One dancer in all frames of a track: the network's answers made poses of one body.

Each step is a function: what was seen and what the network predicts become one estimate of where
joints are (`seen_and_predicted`), which tells the body (`body_estimate`); the body tells which end
of a bone is nearer (`depth_signs`); and poses with its bones are found closest to all that
(`bone_constraints`).

N frames, J joints; x right, y up, z towards the viewer; mm at the size of the one body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.body import retarget
from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.lifting.temporal.apparent_size import growth, size_errors, sizes, sizes_of_body
from dance2pose.lifting.temporal.body_of_track import (
    BodyMeasurements,
    Found,
    Joints,
    find_body,
    unit_of,
)
from dance2pose.lifting.temporal.bone_constraints import with_bone_lengths
from dance2pose.lifting.temporal.depth import Depth
from dance2pose.lifting.temporal.depth_signs import settle_depths
from dance2pose.lifting.temporal.keypoint_errors import jitter
from dance2pose.lifting.temporal.limbs import straightened
from dance2pose.lifting.temporal.smoothness import frames_averaged, smooth_path
from dance2pose.lifting.temporal.track_rows import Rows
from dance2pose.limits import evidence
from dance2pose.limits import model as limits
from dance2pose.poses import FloatArray, IntArray

# The network's errors of depth, by how much of them changes from one frame to the next and how
# much stays: only the first can be smoothed away.
_FLICKER = 0.25
# How far a bone of the wrong length is stretched rather than turned: as a part of the error of its
# depth. Turning alone makes bones that lie about across the view flicker.
_RADIAL = 0.7
# The network's error across the view, as a part of that of the position.
_ACROSS = 1.3


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


@dataclass(frozen=True)
class Posed:
    """xyz: (N, J, 3) mm. errors: what it errs by. px_per_mm: (N,) in the picture
    that was given. found: the dancer's body and the keypoints' errors."""

    xyz: FloatArray
    errors: ErrorParts
    px_per_mm: FloatArray
    found: Found


def pose_one_body(
    answer: Depth,
    seen: Rows,
    settings: SequenceSettings,
    before: Found | None = None,
    *,
    told: bool = False,
    focal_px: float | None = None,
) -> Posed:
    """Poses of one body that agree with the network's answers and with what was seen.

    before: the body and the keypoints' errors as an earlier pass found them. told: the network was
    told them, so that its lengths of bones are no evidence, and they stay; poses get the bones, and
    limits are looked at, then.
    focal_px: of a perspective camera that points at the dancer.
    """
    bias = seen.bias_mm if before is None else before.bias_mm
    size = _size_of_frames(answer, seen, before)
    measurements = _measurements(answer, seen, size, bias, smooth=settings.smooth)
    if before is not None and told:
        found, unit = before, unit_of(measurements, before)
    else:
        found, unit = find_body(measurements)
    joints, size = measurements.joints.scaled(1 / unit), measurements.size * unit
    joints, log_odds = _with_depths_of_body(joints, seen, found, settings)
    xyz = _with_bones(joints, seen, found) if settings.bones and told else joints.xyz
    if settings.limits and told:
        focus = None if focal_px is None else Focus(focal_px, answer.centre, answer.scale * size)
        xyz = _within_limits(xyz, log_odds, seen, found, focus)
    errors = error_parts(
        joints.sigma, answer.sigma / size[:, None], measurements.jitter / unit, found.bias_mm
    )
    return Posed(xyz, errors, answer.scale * size, found)


def _measurements(
    answer: Depth, seen: Rows, size: FloatArray, bias_mm: float, *, smooth: bool
) -> BodyMeasurements:
    """Where joints are by what was seen and predicted, at the size (N,) that the answers have."""
    px_per_mm = answer.scale * size
    picture = (seen.xy - answer.centre[:, None]) / px_per_mm[:, None, None]
    noise = jitter(picture, seen.confidence)
    joints = seen_and_predicted(answer, size, picture, np.hypot(noise, bias_mm))
    if smooth:
        joints = _smoothed_across(joints, noise, bias_mm, seen)
    return BodyMeasurements(joints, picture, noise, answer, size, seen)


def _size_of_frames(answer: Depth, seen: Rows, before: Found | None) -> FloatArray:
    """How large (N,) the dancer is in the network's answers, without what frames err in it."""
    if before is None:
        found, error = sizes(answer.xyz, seen.tree, seen.usual_mm), size_errors(answer.sigma)
    else:
        parents, children = np.array(seen.tree.bones).T
        xyz = np.where(np.isfinite(seen.xy).all(axis=-1, keepdims=True), answer.xyz, np.nan)
        variance = np.square(answer.sigma_z)
        found, error = sizes_of_body(
            xyz[:, children] - xyz[:, parents],
            variance[:, children] + variance[:, parents],
            before.bias_mm,
            before.body,
        )
    return growth(found * answer.scale, error, seen.parts, seen.time_s)


def seen_and_predicted(
    answer: Depth, size: FloatArray, picture: FloatArray, noise: FloatArray
) -> Joints:
    """The network's places drawn to where the joints were seen, by how sure either is."""
    xyz = answer.xyz / size[:, None, None]
    sigma: FloatArray = np.stack(
        [answer.sigma * _ACROSS, answer.sigma * _ACROSS, answer.sigma_z], axis=-1
    )
    seen = np.asarray(np.isfinite(picture).all(axis=-1))
    across = sigma[..., 0] ** 2
    trust = np.where(seen, across / (across + noise**2), 0.0)[..., None]
    xyz[..., :2] += trust * (np.where(seen[..., None], picture, 0.0) - xyz[..., :2])
    sigma[..., :2] *= np.sqrt(1 - trust)
    return Joints(xyz, sigma)


def _smoothed_across(joints: Joints, noise: FloatArray, bias_mm: float, seen: Rows) -> Joints:
    """Paths across the view without jitter; what lasts of the errors stays."""
    xyz, sigma = joints.xyz.copy(), joints.sigma.copy()
    total = np.square(noise) + bias_mm**2
    trust = np.minimum(np.square(sigma[..., 0]) / total, 1.0)  # how far joints are where seen
    jittery = np.where(np.isfinite(seen.xy[..., 0]), trust * noise, sigma[..., 0])
    for part in seen.parts:
        times = seen.time_s[part]
        xyz[part, :, :2] = smooth_path(xyz[part, :, :2], jittery[part, :, None], times)
        kept = 1 - 1 / frames_averaged(jittery[part], times)
        left = np.square(sigma[part, :, 0]) - kept * np.square(jittery[part])
        sigma[part, :, :2] = np.sqrt(np.maximum(left, 0.25))[..., None]
    return Joints(xyz, sigma)


def _smoothed_depths(joints: Joints, seen: Rows) -> Joints:
    xyz = joints.xyz.copy()
    for part in seen.parts:
        flicker = _FLICKER * joints.sigma[part, :, 2:]
        xyz[part, :, 2:] = smooth_path(xyz[part, :, 2:], flicker, seen.time_s[part])
    return Joints(xyz, joints.sigma)


def _with_depths_of_body(
    joints: Joints, seen: Rows, found: Found, settings: SequenceSettings
) -> tuple[Joints, FloatArray]:
    """Depths that agree with the body, and how sure it is which end of each bone is nearer."""
    log_odds: FloatArray = np.zeros((len(joints.xyz), len(found.body.lengths_mm)))
    if settings.flips:
        joints, log_odds = _with_settled_depths(joints, seen, found)
    if settings.smooth:
        joints = _smoothed_depths(joints, seen)
    return joints, log_odds


def _with_settled_depths(joints: Joints, seen: Rows, found: Found) -> tuple[Joints, FloatArray]:
    """Depths that agree with the body, and how sure it is which end of each bone is nearer."""
    xyz, sigma, body = joints.xyz.copy(), joints.sigma.copy(), found.body
    log_odds = np.empty((len(xyz), len(body.lengths_mm)))
    for part in seen.parts:
        xyz[part, :, 2], variance, log_odds[part] = settle_depths(
            xyz[part],
            sigma[part, :, 2],
            np.hypot(sigma[part, :, 0], found.bias_mm),
            seen.time_s[part],
            seen.tree,
            body.lengths_mm,
            spread=body.spread,
        )
        sigma[part, :, 2] = np.sqrt(variance)
    return Joints(xyz, sigma), log_odds


@dataclass(frozen=True)
class Focus:
    """What a perspective camera that points at the dancer makes of nearness. focal_px: its focal
    length. root: (N, 2) px, the first joint from the middle of the picture. px_per_mm: (N,) there.
    """

    focal_px: float
    root: FloatArray
    px_per_mm: FloatArray

    def at(self, rows: IntArray) -> Focus:
        return Focus(self.focal_px, self.root[rows], self.px_per_mm[rows])


def _within_limits(
    xyz: FloatArray, log_odds: FloatArray, seen: Rows, found: Found, focus: Focus | None
) -> FloatArray:
    """Poses with bones mirrored in depth where limits prevail, seen where they were seen before."""
    learned, within = limits.load(seen.skeleton), xyz.copy()
    for part in seen.parts:
        within[part] = evidence.settled(learned, xyz[part], log_odds[part], seen.time_s[part])
    rows = np.flatnonzero((within != xyz).any(axis=(1, 2)))
    mirrored = within[rows]
    if focus is not None:
        mirrored = _seen_as_before(mirrored, xyz[rows], focus.at(rows))
    within[rows] = retarget(mirrored, seen.tree, found.body.lengths_mm)
    return within


def _with_bones(joints: Joints, seen: Rows, found: Found) -> FloatArray:
    """The poses of that body that are closest."""
    body, straight = found.body, straightened(joints, seen.tree, seen.time_s, seen.parts)
    near = with_bone_lengths(
        straight.xyz, bend_variance(straight), seen.tree, body.lengths_mm, spread=body.spread
    )
    return retarget(near, seen.tree, body.lengths_mm)


def bend_variance(joints: Joints) -> FloatArray:
    """How readily (N, J, 3) each coordinate changes, mm^2, for bones to have their lengths."""
    variance = joints.sigma**2 + 1.0
    variance[..., :2] += (_RADIAL * joints.sigma[..., 2:]) ** 2
    return np.asarray(variance)


def _seen_as_before(xyz: FloatArray, before: FloatArray, focus: Focus) -> FloatArray:
    """Poses (N, J, 3) whose joints the camera sees where it saw those of `before`."""
    of_root = (focus.root / focus.px_per_mm[:, None])[:, None]
    larger = nearness(xyz, focus.px_per_mm, focus.focal_px)
    larger /= nearness(before, focus.px_per_mm, focus.focal_px)
    out = xyz.copy()
    out[..., :2] = (xyz[..., :2] + of_root) * larger - of_root
    return out


def nearness(xyz: FloatArray, px_per_mm: FloatArray, focal_px: float) -> FloatArray:
    """What (N, J, 1) brings every joint to the size that it would have at the first joint's
    distance."""
    nearer = xyz[..., 2:] - xyz[:, :1, 2:]
    return np.asarray(np.clip(1 - nearer * (px_per_mm / focal_px)[:, None, None], 0.5, 1.5))


def error_parts(
    solved: FloatArray, predicted: FloatArray, noise: FloatArray, bias_mm: float
) -> ErrorParts:
    """What poses err by.

    solved: (N, J, 3), what is left of the standard deviations after the solution; predicted:
    (N, J), what the network expected before: measured, their geometric mean is closer to the errors
    than either. noise: (N, J), which moves the origin too, the first joint, and with it all others.
    """
    left = np.sqrt(np.square(solved).sum(axis=-1))
    pose = np.sqrt(left * predicted)
    return ErrorParts(pose, np.broadcast_to(noise, pose.shape), bias_mm)
