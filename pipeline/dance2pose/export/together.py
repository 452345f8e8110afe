"""Several dancers on one clock, for forms that hold all of them in one table of times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dance2pose.even_rate import EvenMotion, Times, even, frame_rate
from dance2pose.export.scene import ExportScene
from dance2pose.poses import FloatArray


@dataclass(frozen=True)
class Together:
    """Joints of all dancers one after another. xyz: (T, J1 + J2 + …, 3), NaN where a dancer
    is not there."""

    rate: float
    first: int
    xyz: FloatArray

    @property
    def time_s(self) -> Times:
        return (self.first + np.arange(len(self.xyz))) / self.rate


def on_one_clock(scene: ExportScene) -> Together:
    """All dancers at the highest of their rates, from the first of their frames to the last."""
    rate = max(frame_rate(p.poses.time_s) for p in scene.dancers)
    tracks = [dancer.poses for dancer in scene.dancers]
    motions = [even(track.time_s, track.world_xyz, rate, frame=track.frame) for track in tracks]
    first = min(m.first for m in motions)
    last = max(m.first + len(m.xyz) for m in motions)
    return Together(rate, first, np.concatenate([_placed(m, first, last) for m in motions], axis=1))


def _placed(motion: EvenMotion, first: int, last: int) -> FloatArray:
    out = np.full((last - first, *motion.xyz.shape[1:]), np.nan)
    start = motion.first - first
    out[start : start + len(motion.xyz)] = motion.xyz
    return out
