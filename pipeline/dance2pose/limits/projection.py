"""The valid pose closest to a given one, under learned joint-angle limits."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.limits.body_frames import AZIMUTHS, BIN_DEGREES, ELEVATIONS, parent_bone
from dance2pose.limits.model import Limits
from dance2pose.poses import BoolArray, FloatArray, IntArray

_INSET = 1e-4  # of a unit vector: how far inside the limits a projected direction ends
_CHUNK = 512


def project_to_valid(limits: Limits, xyz: FloatArray) -> FloatArray:
    """The closest valid poses (..., J, 3), bone lengths kept.

    From the torso outwards, each refused bone takes the valid direction closest to its own; bones
    that are valid, and the torso, keep theirs. Unknown bones stay as they are.
    """
    return _project(limits, limits.flat(xyz)).reshape(xyz.shape)


def _project(limits: Limits, poses: FloatArray) -> FloatArray:
    out = np.array(poses, dtype=np.float64)
    known = skeletons.get(limits.skeleton)
    refused = np.flatnonzero(~limits.is_valid(out).all(axis=1))
    changed = out[refused]
    for bone in limits.bones:
        frames = limits.frames(changed)
        for ancestor in limits.bones:
            if ancestor == bone:
                break
            frames.local_direction(ancestor)
        direction = frames.local_direction(bone)
        wrong = np.flatnonzero(~limits.allowed(bone, frames, direction))
        if not len(wrong):
            continue
        if parent_bone(bone) is None:
            number = limits.bones.index(bone)
            fixed = _nearest_occupied(direction[:, wrong].T, limits.occupancy[number])
        else:
            rows = limits.region_rows(bone, frames)[wrong]
            fixed = _nearest_in_region(
                direction[:, wrong].T,
                limits.axes[rows].astype(np.float64),
                limits.low[rows].astype(np.float64),
                limits.high[rows].astype(np.float64),
            )
        direction[:, wrong] = fixed.T
        world = frames.to_world(bone, direction)[:, wrong].T
        world /= np.linalg.norm(world, axis=1, keepdims=True)
        child = known.index(bone)
        _turn(changed, wrong, child, world, known.parents)
    out[refused] = changed
    return out


def _turn(
    poses: FloatArray,
    which: IntArray,
    child: int,
    direction: FloatArray,
    parents: tuple[int, ...],
) -> None:
    """Point the bone to `child` along `direction`, in place; what hangs on it moves along."""
    old = poses[which, child]
    parent = poses[which, parents[child]]
    length = np.linalg.norm(old - parent, axis=1, keepdims=True)
    shift = parent + length * direction - old
    moved = {child}
    for joint in range(child + 1, len(parents)):
        if parents[joint] in moved:
            moved.add(joint)
    for joint in moved:
        poses[which, joint] += shift


def _nearest_occupied(direction: FloatArray, occupancy: BoolArray) -> FloatArray:
    """The closest directions (n, 3) in occupied bins (120, 60)."""
    azimuth_bin, elevation_bin = np.nonzero(_edge(occupancy))
    inset = np.degrees(_INSET)
    west = azimuth_bin * BIN_DEGREES - 180.0 + inset
    south = elevation_bin * BIN_DEGREES - 90.0 + inset
    width = BIN_DEGREES - 2 * inset
    assert AZIMUTHS * BIN_DEGREES == 360 and ELEVATIONS * BIN_DEGREES == 180
    out = np.empty_like(direction)
    for start in range(0, len(direction), _CHUNK):
        part = direction[start : start + _CHUNK]
        azimuth = np.degrees(np.arctan2(part[:, 1], part[:, 0]))[:, None]
        elevation = np.degrees(np.arcsin(np.clip(part[:, 2], -1, 1)))[:, None]
        # Degrees past the bin's west and east edges, the short way round.
        past = (azimuth - west[None] - width / 2 + 180) % 360 - 180
        a = west[None] + width / 2 + np.clip(past, -width / 2, width / 2)
        e = np.clip(elevation, south[None], south[None] + width)
        # Seen from a bin at another longitude the nearest point of its meridian edge is not at
        # the same elevation, but where the great circle to the edge meets it.
        beside = np.radians(past - np.clip(past, -width / 2, width / 2))
        over = np.degrees(np.arctan2(np.tan(np.radians(elevation)), np.cos(beside)))
        over = np.where(np.abs(beside) < np.pi / 2, over, np.where(elevation > 0, 90.0, -90.0))
        e = np.where(np.abs(beside) > 0, np.clip(over, south[None], south[None] + width), e)
        candidates = _from_degrees(a, e)
        best = np.einsum("nbi,ni->nb", candidates, part).argmax(axis=1)
        out[start : start + _CHUNK] = candidates[np.arange(len(part)), best]
    return out


def _edge(occupancy: BoolArray) -> BoolArray:
    """The occupied bins with an empty neighbour, and those at the poles: the nearest is one."""
    inner = occupancy & np.roll(occupancy, 1, axis=0) & np.roll(occupancy, -1, axis=0)
    inner[:, 1:-1] &= occupancy[:, 2:] & occupancy[:, :-2]
    inner[:, [0, -1]] = False
    return occupancy & ~inner


def _from_degrees(azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    flat = np.cos(elevation)
    vectors: FloatArray = np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1
    )
    return vectors


def _nearest_in_region(
    direction: FloatArray, axes: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """The closest unit vectors (n, 3) with low <= axes @ d <= high.

    Each side cuts the sphere in a circle; the closest point lies on one of these circles or where
    two meet, so those few candidates are all tried. The direction itself is invalid.
    """
    low, high = low + _INSET, high - _INSET
    start = np.einsum("nij,nj->ni", axes, direction)  # in the coordinates of the region
    sides = [(axis, bound[:, axis]) for axis in range(3) for bound in (low, high)]
    candidates = [_on_circle(start, axis, value) for axis, value in sides]
    for (first, a), (second, b) in combinations(sides, 2):
        if first != second:
            candidates += _crossings(first, a, second, b)
    points = np.stack(candidates, axis=1)
    slack = _INSET / 10
    inside = ((points >= low[:, None] - slack) & (points <= high[:, None] + slack)).all(axis=-1)
    closeness = np.where(inside, np.einsum("nci,ni->nc", points, start), -np.inf)
    best = closeness.argmax(axis=1)
    chosen = points[np.arange(len(points)), best]
    # A region always holds the directions it was fitted to; this is for damaged ones only.
    chosen = np.where(np.isfinite(closeness.max(axis=1))[:, None], chosen, start)
    world: FloatArray = np.einsum("nij,ni->nj", axes, chosen)
    return world


def _on_circle(start: FloatArray, axis: int, value: FloatArray) -> FloatArray:
    """The points closest to `start` on the circles where coordinate `axis` is `value`."""
    others = [i for i in range(3) if i != axis]
    radius = np.sqrt(np.maximum(1 - value**2, 0))
    rest = start[:, others]
    norm = np.linalg.norm(rest, axis=1)
    rest = np.where(norm[:, None] > 0, rest, [1.0, 0.0]) / np.where(norm > 0, norm, 1)[:, None]
    point = np.empty_like(start)
    point[:, axis] = np.where(np.abs(value) <= 1, value, np.nan)
    point[:, others] = radius[:, None] * rest
    return point


def _crossings(first: int, a: FloatArray, second: int, b: FloatArray) -> list[FloatArray]:
    """Both points of the sphere with two coordinates given, NaN where there are none."""
    with np.errstate(invalid="ignore"):
        third = np.sqrt(1 - a**2 - b**2)
    out: list[FloatArray] = []
    for sign in (1, -1):
        point = np.empty((len(a), 3))
        point[:, first], point[:, second], point[:, 3 - first - second] = a, b, sign * third
        out.append(point)
    return out
