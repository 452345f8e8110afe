"""Training views: takes seen by random cameras, on random bodies, through imperfect detectors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.lifting.temporal.network import (
    JOINTS,
    RATE_HZ,
    NetworkInput,
    longest_projections,
    network_input,
)
from dance2pose.mocap.corpus import Take
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import get

_SKELETON = get("cmu17")
_PARENTS, _CHILDREN = np.array(_SKELETON.bones).T
_MIRROR = np.array(_SKELETON.mirror)
_ROOT, _HEAD, _HIPS, _TOES = 0, 8, [9, 13], [12, 16]
_LEGS = [9, 10, 11, 12, 13, 14, 15, 16]
_LIMBS = ([3, 4], [6, 7], [10, 11, 12], [14, 15, 16], [2, 3, 4], [5, 6, 7])
# How far each joint's detections scatter relative to the average: wrists and ankles most.
_SCATTER = np.array([0.9, 0.8, 0.9, 1.1, 1.4, 0.9, 1.1, 1.4, 0.8] + [0.9, 1.0, 1.2, 1.3] * 2)
_STORED_HZ = 60.0


def _path_matrix() -> FloatArray:
    """(J, J - 1): which bones lead from the root to a joint."""
    path = np.zeros((JOINTS, JOINTS - 1))
    for bone, (parent, child) in enumerate(_SKELETON.bones):
        path[child] = path[parent]
        path[child, bone] = 1
    return path


_PATH = _path_matrix().astype(np.float32)


@dataclass(frozen=True)
class Views:
    """A batch: what the network is given and the truth, both relative to `given.centre`.

    truth: (B, T, J, 3) in the unit of the input (scaled as the camera scales it); per_mm: (B, T)
    of that unit a millimetre.
    """

    given: NetworkInput
    truth: FloatArray
    per_mm: FloatArray


class TakeStore:
    """All takes at 60 frames a second, sampled as clips.

    xyz: (2, N, J, 3) mm, the same frames as cmu17 and as body17, each on its own body.
    """

    def __init__(self, cmu17: Iterable[Take], body17: Iterable[Take]) -> None:
        xyz, root, starts = [], [], [0]
        for cmu, body in zip(cmu17, body17, strict=True):
            step = max(1, round(cmu.rate_hz / _STORED_HZ))
            xyz.append(np.stack([cmu.xyz[::step], body.xyz[::step]]).astype(np.float32))
            path = np.zeros((len(cmu.xyz), 3)) if cmu.root is None else cmu.root
            root.append(path[::step].astype(np.float32))
            starts.append(starts[-1] + xyz[-1].shape[1])
        self.xyz = np.concatenate(xyz, axis=1)
        self.root = np.concatenate(root)
        self.starts = np.array(starts)

    def __len__(self) -> int:
        return len(self.root)

    def clips(
        self, rng: np.random.Generator, body: BoolArray, length: int, far: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses (B, T, J, 3) and root paths (B, T, 3) of clips at about RATE_HZ, and poses
        (B, far, J, 3) from a wider stretch of the same takes. body: (B,) True for body17."""
        count, kind = len(body), body.astype(int)[:, None]
        anywhere = rng.integers(0, len(self), count)
        take = np.searchsorted(self.starts, anywhere, side="right") - 1
        first, last = self.starts[take], self.starts[take + 1] - 1
        pace = _STORED_HZ / RATE_HZ * rng.uniform(0.7, 1.4, count)
        steps = np.arange(length) - rng.integers(0, length, count)[:, None]
        steps *= rng.choice([-1, 1], (count, 1))  # as likely seen backwards
        clip = anywhere[:, None] + np.rint(steps * pace[:, None]).astype(int)
        clip = np.clip(clip, first[:, None], last[:, None])
        # Half of the clips know the whole take, the others only what surrounds them.
        reach = np.where(rng.random(count) < 0.5, 10**6, rng.integers(20, 500, count))
        low, high = np.maximum(first, anywhere - reach), np.minimum(last, anywhere + reach)
        wide = low[:, None] + (rng.random((count, far)) * (high - low + 1)[:, None]).astype(int)
        return self.xyz[kind, clip], self.root[clip], self.xyz[kind, wide]


def random_views(
    store: TakeStore, rng: np.random.Generator, *, count: int, length: int, plain: bool = False
) -> Views:
    """A batch of `count` clips of `length` frames.

    plain: the one body as it is, orthographic cameras within 20 degrees of level, clean keypoints.
    """
    far = 48 if length > 1 else 0
    body = rng.random(count) < (0.0 if plain else 0.4)
    xyz, root, wide = store.clips(rng, body, length, far)
    both = np.concatenate([xyz, wide], axis=1)
    both = _other_bodies(both, body, rng, plain)
    camera = _cameras(rng, count, plain)
    both = np.einsum("bij,btkj->btki", camera, both)
    path = np.einsum("bij,btj->bti", camera, root - root[:, :1])
    path = np.concatenate([path, np.zeros((count, far, 3), np.float32)], axis=1)
    xy, growth = _project(both, path, rng, plain)
    seen, noise = np.ones(xy.shape[:3], bool), np.zeros_like(xy)
    confidence = np.ones(xy.shape[:3])
    if not plain:
        xy = _swapped_sides(xy, rng)
        noise, confidence = _noise(xy.shape, rng)
        seen = _visible(xy.shape[:3], body, rng)
    xy = np.where(seen[..., None], xy + noise, np.nan)
    longest = longest_projections(xy[:, :length])
    known = rng.random(count) < 0.5  # without, the clip is all there is
    if length > 1:
        longest = np.where(known[:, None], longest_projections(xy), longest)
    else:
        longest = np.where(known[:, None], _almost_full(both[:, 0], longest, rng), longest)
    given = network_input(
        xy[:, :length], confidence[:, :length], body_definition=body, longest=longest
    )
    truth = both[:, :length] * growth[:, :length, None, None]
    truth[..., :2] -= given.centre[:, :, None] - 0.0
    return Views(given, truth, growth[:, :length])


def _almost_full(xyz: FloatArray, seen: FloatArray, rng: np.random.Generator) -> FloatArray:
    """What a whole take would show of the bones of single poses (B, J, 3), where seen at all."""
    lengths = np.linalg.norm(xyz[:, _CHILDREN] - xyz[:, _PARENTS], axis=-1)
    short = np.abs(rng.normal(0, rng.uniform(0, 0.06, (len(xyz), 1)), lengths.shape))
    return np.asarray(np.where(np.isfinite(seen), lengths * (1 - short), np.nan))


def _other_bodies(
    xyz: FloatArray, body: BoolArray, rng: np.random.Generator, plain: bool
) -> FloatArray:
    """The same bone directions on bodies of other proportions, half of them mirrored."""
    count = len(xyz)
    bones = xyz[:, :, _CHILDREN] - xyz[:, :, _PARENTS]
    if not plain:
        same = (rng.random(count) < 0.5) & ~body
        parts = rng.normal(1, [0.06, 0.08, 0.06, 0.08, 0.08], (count, 5))
        groups = np.array([0, *(1, 2, 2) * 2, 3, *(4, 2, 2, 3) * 2])
        ratio = np.clip(parts[:, groups], 0.75, 1.3)
        limb = rng.normal(1, 0.05, (count, JOINTS - 1))
        limb = (limb + limb[:, _MIRROR[1:] - 1]) / 2  # left and right alike
        ratio = np.where(same[:, None], 1.0, ratio * np.clip(limb, 0.85, 1.15))
        bones = bones * ratio[:, None, :, None].astype(np.float32)
    out = np.matmul(_PATH, bones)
    flip = rng.random(count) < 0.5
    out[flip] = out[flip][:, :, _MIRROR] * np.array([-1, 1, 1], np.float32)
    return out


def _cameras(rng: np.random.Generator, count: int, plain: bool) -> FloatArray:
    """View-from-world rotations (B, 3, 3): any azimuth, mostly small tilt, little roll."""
    azimuth = rng.uniform(0, 360, count)
    if plain:
        tilt, roll = rng.uniform(-20, 20, count), np.zeros(count)
    else:
        kind = rng.random(count)
        tilt = np.where(kind < 0.8, rng.uniform(-28, 28, count), rng.uniform(-90, 90, count))
        roll = rng.normal(0, np.where(kind < 0.9, 4, 20), count)
    angles = np.stack([azimuth, tilt, roll], axis=-1)
    return np.asarray(Rotation.from_euler("yxz", angles, degrees=True).as_matrix(), np.float32)


def _project(
    xyz: FloatArray, path: FloatArray, rng: np.random.Generator, plain: bool
) -> tuple[FloatArray, FloatArray]:
    """2D (B, T, J, 2) and how much larger than life (B, T) the camera shows the root's plane."""
    count = len(xyz)
    orthographic = np.full(count, True) if plain else rng.random(count) < 0.6
    distance = np.exp(rng.uniform(np.log(2000), np.log(9000), count))
    at = np.maximum(distance[:, None] - path[..., 2], 0.6 * distance[:, None])
    growth = np.where(orthographic[:, None], 1.0, distance[:, None] / at)
    depth = np.where(
        orthographic[:, None, None], 1.0, np.maximum(1 - xyz[..., 2] / at[:, :, None], 0.3)
    )
    return np.asarray(xyz[..., :2] * (growth[:, :, None] / depth)[..., None]), growth


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """White and slow noise (B, T, J, 2) in mm, and confidences (B, T, J) that partly tell it."""
    count, frames = shape[:2]

    # Nothing tells the noise of a single picture, so that a network that often sees noisy ones
    # hedges on clean ones; in clips it shows.
    unseen = 0.0 if frames > 1 else 0.3

    def level(clean: float, most: float) -> FloatArray:
        some = rng.random(count) > clean + unseen
        return np.asarray(np.where(some, rng.uniform(0, most, count), 0.0))

    white = rng.standard_normal(shape, np.float32) * level(0.35, 16)[:, None, None, None]
    slow = rng.standard_normal(shape, np.float32)
    keep = rng.uniform(0.5, 0.9, (count, 1, 1)).astype(np.float32)
    for t in range(1, frames):
        slow[:, t] = keep * slow[:, t - 1] + np.sqrt(1 - keep**2) * slow[:, t]
    slow *= (level(0.6, 15)[:, None] * _SCATTER)[:, None, :, None]
    worse = rng.random(shape[:3]) < (0.06 * (rng.random(count) < 0.3))[:, None, None]
    told = (rng.random(count) < 0.6)[:, None, None]
    confidence = np.where(worse & told, rng.uniform(0.2, 0.8, shape[:3]), 1.0)
    jumps = rng.standard_normal(shape, np.float32) * (60 * worse)[..., None]
    noise = white + slow + jumps
    noise[rng.random(count) < 0.25] = 0
    return np.asarray(noise), confidence


def _swapped_sides(xy: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Left and right legs or arms confused for a few frames, in one clip of twelve."""
    count, frames = xy.shape[:2]
    for b in np.flatnonzero(rng.random(count) < 0.08):
        start = int(rng.integers(0, frames))
        left, right = (
            ([9, 10, 11, 12], [13, 14, 15, 16]) if rng.random() < 0.6 else ([2, 3, 4], [5, 6, 7])
        )
        run = slice(start, start + int(rng.integers(1, 6)))
        xy[b, run] = xy[b, run][:, _swap_order(left, right)]
    return xy


def _swap_order(left: list[int], right: list[int]) -> list[int]:
    order = list(range(JOINTS))
    for a, b in zip(left, right, strict=True):
        order[a], order[b] = b, a
    return order


def _visible(shape: tuple[int, ...], body: BoolArray, rng: np.random.Generator) -> BoolArray:
    """Which joints (B, T, J) are seen: runs of missing joints, whole limbs, legs, toes, heads."""
    count, frames, joints = shape
    seen = np.ones(shape, bool)
    share = np.where(rng.random(count) < 0.4, rng.uniform(0, 0.3, count), 0.0)
    longest = rng.choice([6, 12, 24], count)
    mean_run = (2 + longest) / 2
    begins = rng.random(shape) < (share / mean_run)[:, None, None]
    run = rng.integers(2, np.maximum(longest, 3)[:, None, None], shape)
    left = np.zeros((count, joints), int)
    for t in range(frames):
        left = np.where(begins[:, t], run[:, t], left - 1)
        seen[:, t] &= left <= 0
    if frames <= 2:  # single pictures: joints are simply not there
        seen &= rng.random(shape) >= share[:, None, None]
    for b in np.flatnonzero(rng.random(count) < 0.05):  # half-body shots
        seen[b, :, [j for j in _LEGS if j not in _HIPS or rng.random() < 0.4]] = False
        if not seen[b, :, _HIPS].any():
            seen[b, :, _ROOT] = rng.random() < 0.3
    for b in np.flatnonzero(rng.random(count) < 0.05):
        seen[b, :, _LIMBS[rng.integers(len(_LIMBS))]] = False
    toeless = rng.random(count) < np.where(body, 0.75, 0.15)
    seen[np.ix_(toeless, np.arange(frames), _TOES)] = False
    seen[rng.random(count) < 0.05, :, _HEAD] = False
    hipless = body & ~seen[:, :, _HIPS].all(axis=(1, 2))  # body17's midpoints need both sides
    seen[hipless, :, _ROOT] &= seen[hipless][:, :, _HIPS].all(axis=-1)
    return seen
