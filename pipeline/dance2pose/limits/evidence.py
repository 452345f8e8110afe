"""Joint-angle limits as evidence of which end of a bone is nearer.

A camera leaves two poses of every bone, one the other's mirror image in depth, and which of them it
is can only change where the bone lies across the view. Between two such moments all frames stand or
fall together. Where the body could hardly hold the one and could well hold the other, that speaks
for the other; it is weighed with what else is known, and where it prevails the bone is mirrored.
What was seen stays as it was seen, lengths stay, and nothing jumps. A bone that lies outside its
limits either way stays as it is.
"""

from __future__ import annotations

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.limits.model import FEWEST_TAKES, Limits
from dance2pose.poses import BoolArray, FloatArray, IntArray

# What one independent frame outside the limits says against a pose, as a logarithm of odds: limits
# are learned from few dancers, so that much of what they refuse is only new.
_AGAINST = 1.0
_INDEPENDENT_S = 0.7
# A bone may change sides where it is turned out of the picture's plane by no more than this, sine,
# and where that makes it turn by no more than this from one frame to the next.
_ACROSS, _MOST_TURN_DEG = np.sin(np.radians(14.0)), 35.0


def settled(
    limits: Limits, xyz: FloatArray, log_odds: FloatArray, time_s: FloatArray
) -> FloatArray:
    """Poses (T, J, 3) with bones mirrored in depth where limits prevail.

    x and y across the view, z towards the viewer. log_odds: (T, J - 1), positive, for the poses as
    they are, from all else that is known. time_s: (T,).
    """
    known = skeletons.get(limits.skeleton)
    out, cost = xyz, _cost(limits, xyz)
    share = _share_of_evidence(time_s)[:, None]
    linked = np.diff(time_s) < _INDEPENDENT_S
    for bone in limits.bones:
        child = known.index(bone)
        limb = np.array([joint - 1 for joint in _outwards(child, known.parents)])
        suspect = np.asarray(cost[:, limb].any(axis=1))
        if not suspect.any():
            continue
        parent = known.parents[child]
        runs = _runs(out[:, child] - out[:, parent], suspect, linked)
        if not runs:
            continue
        rows = np.concatenate(runs)
        mirrored = _mirrored(out[rows], child, known.parents)
        other = _cost(limits, mirrored)
        gain = _AGAINST * (share[rows] * (cost[rows][:, limb] - other[:, limb])).sum(axis=1)
        change = _prevails(gain, np.abs(log_odds[rows, child - 1]), runs)
        if change.any():
            out = out.copy()
            out[rows[change]] = mirrored[change]
            cost[rows[change]] = other[change]
    return out


def _cost(limits: Limits, xyz: FloatArray) -> FloatArray:
    """How much (T, J - 1) speaks against bones: 1 outside limits that many takes came up to."""
    verdict = limits.verdict(xyz)
    sure = np.minimum(verdict.takes / (2.0 * FEWEST_TAKES), 1.0)
    return np.asarray(np.where(verdict.valid, 0.0, sure))


def _prevails(gain: FloatArray, sure: FloatArray, runs: list[IntArray]) -> BoolArray:
    """Whether what frames gain together is more than the surest of their run, frame by frame.

    gain, sure: of the frames of all runs, one after the other."""
    lengths = [len(run) for run in runs]
    starts = np.cumsum([0, *lengths[:-1]])
    together, surest = np.add.reduceat(gain, starts), np.maximum.reduceat(sure, starts)
    return np.repeat(together > surest, lengths)


def _outwards(joint: int, parents: tuple[int, ...]) -> list[int]:
    """The joint and all that hang on it."""
    moved = {joint}
    for other in range(joint + 1, len(parents)):
        if parents[other] in moved:
            moved.add(other)
    return sorted(moved)


def _mirrored(xyz: FloatArray, child: int, parents: tuple[int, ...]) -> FloatArray:
    """The same with one bone's other end nearer; what hangs on it moves along."""
    out = xyz.copy()
    step = 2 * (xyz[:, child, 2] - xyz[:, parents[child], 2])
    out[:, _outwards(child, parents), 2] -= step[:, None]
    return out


def _runs(bone: FloatArray, suspect: BoolArray, linked: BoolArray) -> list[IntArray]:
    """Frames in which a bone (T, 3) can only change sides together, where any is suspect.

    linked: (T - 1,) False between frames that are too far apart to belong together.
    """
    direction = bone / np.maximum(np.linalg.norm(bone, axis=1, keepdims=True), 1e-9)
    sine = direction[:, 2]
    size = np.abs(sine)
    least = np.r_[False, (size[1:-1] <= size[:-2]) & (size[1:-1] < size[2:]), False][: len(size)]
    crossed = np.r_[False, np.sign(sine[1:]) != np.sign(sine[:-1])]
    cut = crossed | (least & (size < _ACROSS)) | np.r_[False, ~linked]
    starts = np.r_[0, np.flatnonzero(cut)]
    stops = np.r_[starts[1:], len(bone)]
    told = np.logical_or.reduceat(suspect, starts)
    return [
        np.arange(start, stop)
        for start, stop in zip(starts[told], stops[told], strict=True)
        if _turns_little(direction, linked, start, stop)
    ]


def _turns_little(direction: FloatArray, linked: BoolArray, start: int, stop: int) -> bool:
    """Whether mirroring frames start..stop adds no jump at either end."""
    for at in (start, stop):
        if 0 < at < len(direction) and linked[at - 1]:
            before, after = direction[at - 1], direction[at]
            as_it_is, mirrored = before @ after, before @ (after * [1.0, 1.0, -1.0])
            if mirrored < min(as_it_is, np.cos(np.radians(_MOST_TURN_DEG))):
                return False
    return True


def _share_of_evidence(time_s: FloatArray) -> FloatArray:
    """How much (T,) each frame counts of an independent one."""
    if len(time_s) < 2:
        return np.ones(len(time_s))
    step = np.diff(time_s)
    between = (np.r_[step[:1], step] + np.r_[step, step[-1:]]) / 2
    return np.asarray(np.minimum(between / _INDEPENDENT_S, 1.0))
