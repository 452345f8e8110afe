"""What the depth network is given and what it returns: the one definition of both.

The network (models/lifter.onnx, trained by scripts/train_lifter.py) sees a track's 2D joints
resampled to RATE_HZ, root-centred and divided by the track's own scale, and answers with 3D joints
and how sure it is of them. Axes here are x right, y up, z towards the viewer, in mm on the one body
of mocap/corpus.py once multiplied by the scale.

Bodies differ: the track's longest projections say something of the dancer's bones, and once more
is known of them it can be given instead.

B clips, T frames, J = 17 joints of cmu17 or body17, F features.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dance2pose.body import BODY17_BONES_MM, BODY_BONES_MM
from dance2pose.poses import BoolArray, FloatArray, IntArray
from dance2pose.skeleton import get

# Frames per second that the network's temporal filters are trained at.
RATE_HZ = 15.0
JOINTS = 17
BONES = JOINTS - 1
# x, y and confidence of every joint; of every bone its length, as far as it is known, and how far
# its ends must then lie apart in depth (twice: a bone taken to be no shorter than the one body's,
# and as it was seen or is known); the kind of skeleton; whether lengths are known, or only seen;
# whether the figure's size is known; whether the keypoints' error is stated, and the error.
FEATURES = 3 * JOINTS + 3 * BONES + 5
DEFINITION = 3 * JOINTS + 2 * BONES  # the feature that is 1 for body17 and -1 for cmu17
# Frames at RATE_HZ from the nearest sight of a joint after which its place is not guessed at.
_HELD = 12
# Correction of x and y, z, log of the standard deviation of z, log of that of the position.
OUTPUTS = 5
# Of every bone: log of its length beside the one body's, and log of how far that may be off.
BONE_OUTPUTS = 2
_ERROR_MM = 20.0  # keypoint errors of order one
# The projection of a bone that is reported as its longest: this quantile over the track, so that a
# few wrong keypoints do not set the scale.
_LONGEST = 0.95
_PARENTS, _CHILDREN = np.array(get("cmu17").bones).T
_UNIT_MM = 250.0  # features and outputs are of order one


@dataclass(frozen=True)
class NetworkInput:
    """features: (B, T, F) float32. centre: (B, T, 2) and scale: (B,) undo the normalisation:
    input unit = centre + scale * mm."""

    features: npt.NDArray[np.float32]
    centre: FloatArray
    scale: FloatArray


def network_input(
    xy: FloatArray,
    confidence: FloatArray,
    *,
    body_definition: BoolArray,
    longest: FloatArray | None = None,
    known: BoolArray | None = None,
    scale: FloatArray | None = None,
    error_mm: FloatArray | None = None,
) -> NetworkInput:
    """Normalised features of clips.

    xy: (B, T, J, 2) y up, NaN where missing, uniform in time. confidence: (B, T, J) in 0..1, about
    1 for a joint seen as well as its detector sees any. body_definition: (B,) True for body17,
    False for cmu17. longest: (B, J - 1) from `longest_projections` over the whole track that the
    clip is from; of the clip itself by default. known: (B,) True where `longest` are the dancer's
    bone lengths, as well as they are known, rather than projections. scale: (B,) input units per
    mm where the figure's size is known, NaN where `longest` shall tell it; a bone whose `longest`
    is NaN may then have any length. error_mm: (B,) standard deviation of the keypoints' slow
    errors in each direction, mm at the dancer's size; NaN where nothing is stated.
    """
    if longest is None:
        longest = longest_projections(xy)
    clips = len(xy)
    known = np.zeros(clips, bool) if known is None else known
    scale = np.full(clips, np.nan) if scale is None else scale
    error_mm = np.full(clips, np.nan) if error_mm is None else error_mm
    seen = np.isfinite(xy).all(axis=-1)
    filled = held_through_gaps(xy, held=_HELD)
    centre = filled[:, :, 0].copy()
    unseen_root = ~np.isfinite(centre).all(axis=-1)
    if unseen_root.any():
        centre[unseen_root] = _mean_of_finite(filled[unseen_root])
    centre = np.nan_to_num(centre)
    bones = np.where(body_definition[:, None], BODY17_BONES_MM, BODY_BONES_MM)
    sized = np.isfinite(scale)
    scale = np.where(sized, scale, track_scale(longest, bones))
    unit = (scale * _UNIT_MM)[:, None, None, None]
    relative = np.nan_to_num((filled - centre[:, :, None]) / unit)
    weight = np.where(seen, confidence, 0.0)
    lengths = np.nan_to_num(longest / (scale[:, None] * bones))
    full = np.fmax(longest, scale[:, None] * bones)[:, None]
    across = np.linalg.norm(filled[:, :, _CHILDREN] - filled[:, :, _PARENTS], axis=-1)
    apart = np.nan_to_num(np.sqrt(np.maximum(full**2 - across**2, 0.0)) / unit[..., 0])
    as_known = np.maximum(longest[:, None] ** 2 - across**2, 0.0)
    as_known = np.nan_to_num(np.sqrt(as_known) / unit[..., 0])
    shape = (*xy.shape[:2], BONES)
    of_clip = np.stack(
        [
            np.where(body_definition, 1.0, -1.0),
            known,
            sized,
            np.isfinite(error_mm),
            np.nan_to_num(error_mm) / _ERROR_MM,
        ],
        axis=-1,
    )
    definition, stated = of_clip[:, None, :1], of_clip[:, None, 1:]
    features = np.concatenate(
        [
            relative.reshape(*xy.shape[:2], 2 * JOINTS),
            weight,
            apart,
            np.broadcast_to(lengths[:, None], shape),
            np.broadcast_to(definition, (*shape[:2], 1)),
            as_known,
            np.broadcast_to(stated, (*shape[:2], 4)),
        ],
        axis=-1,
    )
    return NetworkInput(features.astype(np.float32), centre, scale)


def _mirror_of_features() -> tuple[IntArray, npt.NDArray[np.float32]]:
    """Where each feature (F,) of a mirrored clip is found, and its sign (F,)."""
    joints = np.array(get("cmu17").mirror)
    bones = joints[1:] - 1
    of_clip = np.arange(1)
    parts = [2 * np.repeat(joints, 2) + np.tile([0, 1], JOINTS), joints, bones, bones, of_clip]
    parts += [bones, np.arange(4)]
    starts = np.cumsum([0, *(len(part) for part in parts[:-1])])
    sign = np.ones(FEATURES, np.float32)
    sign[: 2 * JOINTS : 2] = -1
    return np.concatenate([start + part for start, part in zip(starts, parts, strict=True)]), sign


_MIRROR, _MIRROR_SIGN = _mirror_of_features()


def mirrored(given: NetworkInput) -> NetworkInput:
    """The input of the clips' mirror images: left and right changed, x negated."""
    features = given.features[..., _MIRROR] * _MIRROR_SIGN
    return NetworkInput(features, given.centre * [-1.0, 1.0], given.scale)


def network_output(
    raw: FloatArray, given: NetworkInput
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position (B, T, J, 3) mm, standard deviation of z and of the position (B, T, J) mm.

    raw: (B, T, J, 5) as the network returns it. The position is relative to the input's centre.
    """
    relative = given.features[..., : 2 * JOINTS].reshape(*raw.shape[:3], 2)
    xyz = np.concatenate([relative + raw[..., :2], raw[..., 2:3]], axis=-1) * _UNIT_MM
    return xyz, np.exp(raw[..., 3]) * _UNIT_MM, np.exp(raw[..., 4]) * _UNIT_MM


def longest_projections(xy: FloatArray) -> FloatArray:
    """About the longest projection (B, J - 1) of each bone over the frames of (B, T, J, 2).

    NaN for a bone that is never seen. A camera that does not zoom shows a bone at its full length
    whenever it lies across the view, so this tells both the scale and the dancer's proportions.
    """
    lengths = np.linalg.norm(xy[:, :, _CHILDREN] - xy[:, :, _PARENTS], axis=-1)
    ordered = np.sort(lengths, axis=1)  # NaN last
    known = np.isfinite(lengths).sum(axis=1)
    position = np.maximum(known - 1, 0) * _LONGEST
    low = position.astype(int)
    high = np.minimum(low + 1, np.maximum(known - 1, 0))
    at_low = np.take_along_axis(ordered, low[:, None], axis=1)[:, 0]
    at_high = np.take_along_axis(ordered, high[:, None], axis=1)[:, 0]
    return np.asarray(at_low + (position - low) * (at_high - at_low))


def track_scale(longest: FloatArray, bones_mm: FloatArray) -> FloatArray:
    """Input units per mm (B,) from (B, J - 1) longest projections of bones of these lengths.

    1 where nothing is known.
    """
    known = np.isfinite(longest)
    seen = np.where(known, longest, 0.0).sum(axis=-1)
    body = np.where(known, bones_mm, 0.0).sum(axis=-1)
    good = (body > 0) & (seen > 0)
    return np.where(good, seen / np.where(good, body, 1.0), 1.0)


def held_through_gaps(values: FloatArray, *, held: int) -> FloatArray:
    """Missing points of (B, T, J, D) by linear interpolation in time, held at the ends.

    A point more than `held` frames from where it was seen, or never seen, stays NaN.
    """
    seen = np.asarray(np.isfinite(values).all(axis=-1))
    if seen.all():
        return values
    steps = np.arange(values.shape[1])[None, :, None]
    before = np.maximum.accumulate(np.where(seen, steps, -1), axis=1)
    after = np.minimum.accumulate(np.where(seen, steps, values.shape[1])[:, ::-1], axis=1)[:, ::-1]
    before, after = (
        np.where(before < 0, after, before),
        np.where(after == values.shape[1], before, after),
    )
    never = before == values.shape[1]
    before, after = np.where(never, 0, before), np.where(never, 0, np.maximum(after, 0))
    span = np.maximum(after - before, 1)
    share = np.where(after > before, (steps - before) / span, 0.0)[..., None]
    start = np.take_along_axis(values, before[..., None], axis=1)
    end = np.take_along_axis(values, after[..., None], axis=1)
    far = np.minimum(np.abs(steps - before), np.abs(after - steps)) > held
    guessed = np.where(far[..., None], np.nan, start + share * (end - start))
    return np.where(seen[..., None], values, guessed)


def _mean_of_finite(points: FloatArray) -> FloatArray:
    """Mean over J of (N, J, 2), 0 where none is known."""
    known = np.asarray(np.isfinite(points).all(axis=-1))[..., None]
    total = np.where(known, points, 0.0).sum(axis=-2)
    return np.asarray(total / np.maximum(known.sum(axis=-2), 1))
