"""The takes that training views are drawn from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dance2pose.body import bone_lengths
from dance2pose.lifting.temporal.network import RATE_HZ
from dance2pose.mocap.corpus import Take
from dance2pose.poses import BoolArray, FloatArray, IntArray
from dance2pose.skeleton import get

_STORED_HZ = 60.0
_PARENTS, _CHILDREN = np.array(get("cmu17").bones).T


@dataclass(frozen=True)
class Clips:
    """bones: (B, T + far, J - 1, 3) mm, the clip's frames, then frames from elsewhere in the same
    take. root: (B, T, 3) mm. take: (B,) rows of the store's `lengths`."""

    bones: FloatArray
    root: FloatArray
    take: IntArray


class TakeStore:
    """All takes at 60 frames a second, sampled as clips.

    bones: (2, N, J - 1, 3) mm, the same frames as cmu17 and as body17. lengths: (2, takes, J - 1)
    mm, those of each take's performer; of_performer: rows of takes that know their performer's.
    names: of the takes.
    """

    def __init__(self, cmu17: Iterable[Take], body17: Iterable[Take]) -> None:
        bones, root, lengths, performed, starts = [], [], [], [], [0]
        self.names: list[str] = []
        for pair in zip(cmu17, body17, strict=True):
            step = max(1, round(pair[0].rate_hz / _STORED_HZ))
            xyz = np.stack([take.xyz[::step] for take in pair]).astype(np.float32)
            self.names.append(pair[0].name)
            bones.append(xyz[:, :, _CHILDREN] - xyz[:, :, _PARENTS])
            lengths.append([bone_lengths(take.xyz, get(take.skeleton)) for take in pair])
            path = pair[0].root
            performed.append(path is not None)  # takes of positions alone are on the one body
            path = np.zeros((len(pair[0].xyz), 3)) if path is None else path
            root.append(path[::step].astype(np.float32))
            starts.append(starts[-1] + xyz.shape[1])
        self.bones = np.concatenate(bones, axis=1)
        self.root = np.concatenate(root)
        self.lengths = np.array(lengths).swapaxes(0, 1)
        self.of_performer = np.flatnonzero(performed)
        self.starts = np.array(starts)

    def __len__(self) -> int:
        return len(self.root)

    def clips(self, rng: np.random.Generator, body17: BoolArray, length: int, far: int) -> Clips:
        """Clips of `length` frames at about RATE_HZ, with `far` frames from a wider stretch of the
        same takes. body17: (B,) True for body17, False for cmu17."""
        count, kind = len(body17), body17.astype(int)[:, None]
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
        return Clips(self.bones[kind, np.concatenate([clip, wide], axis=1)], self.root[clip], take)
