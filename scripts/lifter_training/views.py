"""Training views: takes seen by random cameras, on random bodies, through imperfect detectors.

B clips, T frames, J joints of cmu17 or body17.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.lifting.temporal.network import NetworkInput, longest_projections, network_input
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import get
from lifter_training.bodies import bodies, limbs_stretched, limbs_turned, posed
from lifter_training.detections import Noise, noise, swapped_sides, visible
from lifter_training.takes import TakeStore

_PARENTS, _CHILDREN = np.array(get("cmu17").bones).T
_FAR = 48  # frames from elsewhere in a take that tell of its longest projections
_NEAREST_MM, _FARTHEST_MM = 2000.0, 10000.0
_STEEP = (0.2, 0.35)  # share of cameras at any tilt, of clips and of single pictures


@dataclass(frozen=True)
class Mixture:
    """What views are drawn from.

    training: cameras of every kind, imperfect detectors, what is known of the body differing from
    clip to clip. Otherwise: perspective is undone, cameras within 20 degrees of level, keypoints
    exact but for slow errors of `slow_mm`, longest projections of the whole take. body: "mixed",
    "own" (the performers'), "drawn" (from human variation) or "one". body17: share of clips.
    """

    training: bool = True
    body: str = "mixed"
    slow_mm: float = 0.0
    body17: float = 0.4


@dataclass(frozen=True)
class Views:
    """A batch: what the network is given and the truth, both relative to `given.centre`.

    truth: (B, T, J, 3) in the unit of the input (scaled as the camera scales it); per_mm: (B, T)
    of that unit a millimetre.
    """

    given: NetworkInput
    truth: FloatArray
    per_mm: FloatArray


def random_views(
    store: TakeStore,
    rng: np.random.Generator,
    *,
    count: int,
    length: int,
    mixture: Mixture = Mixture(),
) -> Views:
    """A batch of `count` clips of `length` frames."""
    far = _FAR if length > 1 else 0
    body17 = rng.random(count) < mixture.body17
    clips = store.clips(rng, body17, length, far)
    lengths = bodies(store, clips, body17, rng, mixture.body)
    bones = clips.bones
    if mixture.training:
        bones = limbs_stretched(limbs_turned(bones, rng), rng)
    both = posed(bones, lengths, rng)
    steep = _STEEP[length == 1] if mixture.training else 0.0
    camera = _cameras(rng, count, steep, training=mixture.training)
    both = (both.reshape(count, -1, 3) @ camera.mT).reshape(both.shape)
    path = (clips.root - clips.root[:, :1]) @ camera.mT
    path = np.concatenate([path, np.zeros((count, far, 3), np.float32)], axis=1)
    orthographic = np.full(count, True) if not mixture.training else rng.random(count) < 0.5
    xy, growth = _project(both, path, orthographic, rng)
    if mixture.training:
        xy = swapped_sides(xy, rng)
        errors = noise(xy.shape, length, rng)
        seen = visible(xy.shape[:3], body17, rng)
    else:
        level = np.full(count, mixture.slow_mm)
        offset = rng.standard_normal(xy.shape) * mixture.slow_mm
        offset[:, 1:length] = offset[:, :1]
        errors, seen = Noise(offset, np.ones(xy.shape[:3]), level), np.ones(xy.shape[:3], bool)
    xy = np.where(seen[..., None], xy + errors.offset, np.nan)
    given = _given(xy, errors, both, lengths, body17, length, rng, training=mixture.training)
    truth = both[:, :length] * growth[:, :length, None, None]
    truth[..., :2] -= given.centre[:, :, None]
    return Views(given, truth, growth[:, :length])


def _given(
    xy: FloatArray,
    errors: Noise,
    xyz: FloatArray,
    lengths: FloatArray,
    body17: BoolArray,
    length: int,
    rng: np.random.Generator,
    *,
    training: bool,
) -> NetworkInput:
    """What the network is told of the body and of the keypoints, which differs from clip to clip.

    A track: longest projections of the clip alone or of the whole take, or bone lengths as found
    in an earlier pass. A single picture: nothing, or the figure's size, or bone lengths as well.
    """
    count, single = len(xy), length == 1
    clip = longest_projections(xy[:, :length])
    way = rng.random(count) if training else np.full(count, 0.5)
    known, sized = way < 0.35, np.zeros(count, bool)
    longest = clip
    if single:
        known, sized = way < 0.25, (way >= 0.25) & (way < 0.65)
        sized &= training
        longest = np.where(sized[:, None], np.nan, longest)
    else:
        known &= training
        longest = np.where((way < 0.8)[:, None], longest_projections(xy), clip)
    about = rng.normal(1, 0.03 if single else 0.015, count)
    off = rng.normal(0, rng.uniform(0, 0.05, (count, 1)), lengths.shape)
    longest = np.where(known[:, None], lengths * np.exp(off) * about[:, None], longest)
    stated = (rng.random(count) < 0.4) & training
    told = errors.level * np.exp(rng.normal(0, 0.25, count))
    return network_input(
        xy[:, :length],
        errors.confidence[:, :length],
        body_definition=body17,
        longest=longest,
        known=known,
        scale=np.where(sized, about, np.nan),
        error_mm=np.where(stated, told, np.nan),
    )


def _cameras(rng: np.random.Generator, count: int, steep: float, *, training: bool) -> FloatArray:
    """View-from-world rotations (B, 3, 3): any azimuth, mostly small tilt, little roll.

    steep: share of cameras at any tilt.
    """
    azimuth = rng.uniform(0, 360, count)
    if training:
        level = rng.random(count) >= steep
        tilt = np.where(level, rng.uniform(-28, 28, count), rng.uniform(-90, 90, count))
        roll = rng.normal(0, np.where(rng.random(count) < 0.9, 4, 20), count)
    else:
        tilt, roll = rng.uniform(-20, 20, count), np.zeros(count)
    angles = np.stack([azimuth, tilt, roll], axis=-1)
    return np.asarray(Rotation.from_euler("yxz", angles, degrees=True).as_matrix(), np.float32)


def _project(
    xyz: FloatArray, path: FloatArray, orthographic: BoolArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """2D (B, T, J, 2) and how much larger than life (B, T) the camera shows the root's plane."""
    distance = np.exp(rng.uniform(np.log(_NEAREST_MM), np.log(_FARTHEST_MM), len(xyz)))
    at = np.maximum(distance[:, None] - path[..., 2], 0.6 * distance[:, None])
    growth = np.where(orthographic[:, None], 1.0, distance[:, None] / at)
    depth = np.where(
        orthographic[:, None, None], 1.0, np.maximum(1 - xyz[..., 2] / at[:, :, None], 0.3)
    )
    larger = (growth[:, :, None] / depth).astype(np.float32)
    return np.asarray(xyz[..., :2] * larger[..., None]), growth
