"""Learning joint-angle limits from motion capture (after Akhter & Black, CVPR 2015, section 3).

`seen_directions` sums up what a corpus shows; `widen` turns that into limits with a margin, so that
one pass over the corpus serves every margin that is tried.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from dance2pose.limits import body_frames
from dance2pose.limits.body_frames import AZIMUTHS, BIN_DEGREES, ELEVATIONS, BodyFrames
from dance2pose.limits.model import Limits
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import FloatArray, IntArray
from dance2pose.skeleton import get


@dataclass(frozen=True)
class Margins:
    """How far the limits lie beyond what was seen, degrees.

    occupancy_deg: a torso bone's direction is valid where a seen one is this close to the centre
    of its bin. region_deg: half-space and box are moved outwards by this angle.

    The defaults are the widest, of those measured by limits_trade_off, at which every single bone
    is still refused more often than not when it is turned at random: dancers who are not in the
    corpus move in ways that it does not show.
    """

    occupancy_deg: float = 8.0
    region_deg: float = 16.0


@dataclass(frozen=True)
class ObservationSettings:
    """How directions are summed up.

    rate_hz: frames looked at a second. parent_radius_deg: a bin's region is fitted to the poses
    whose parent bone is this close to the bin's centre; where fewer than `fewest` are, to the
    `fewest` closest. trimmed: share of these left outside each side of a box, for the capture's
    own errors. spacing_deg: directions about this close count once, so that hours of standing
    do not outweigh one leap. border_deg: a take came as far as a direction where it came this
    close to it.
    """

    rate_hz: float = 30.0
    parent_radius_deg: float = 15.0
    fewest: int = 60
    trimmed: float = 0.002
    spacing_deg: float = 2.0
    border_deg: float = 8.0


@dataclass(frozen=True)
class SeenDirections:
    """What a corpus shows of the limited bones of one skeleton, without any margin.

    distance_deg: (B_torso, 120, 60) angle from a bin's centre to the nearest seen direction.
    The rest as in Limits, with low and high before they are widened.
    """

    skeleton: str
    references: FloatArray
    distance_deg: FloatArray
    region: npt.NDArray[np.int32]
    axes: FloatArray
    low: FloatArray
    high: FloatArray
    takes: npt.NDArray[np.uint8]
    settings: ObservationSettings


def training_poses(takes: list[Take], rate_hz: float) -> tuple[FloatArray, IntArray]:
    """Poses (N, J, 3) of the takes at one rate, and the same mirrored; the take (N,) of each."""
    parts = [resample(take, rate_hz).xyz if take.rate_hz > rate_hz else take.xyz for take in takes]
    poses = np.concatenate(parts)
    mirrored = poses[:, list(get(takes[0].skeleton).mirror)] * [-1.0, 1.0, 1.0]
    both: FloatArray = np.concatenate([poses, mirrored])
    number = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return both, np.tile(number, 2)


def seen_directions(
    xyz: FloatArray,
    skeleton: str,
    settings: ObservationSettings | None = None,
    *,
    take: IntArray | None = None,
) -> SeenDirections:
    """Sum up the poses (N, J, 3) of a lifting skeleton, any unit, all joints known.

    take: (N,) the number of the take that each pose is from; by default all are from one.
    """
    settings = settings or ObservationSettings()
    take = np.zeros(len(xyz), int) if take is None else take
    bones = body_frames.limited_bones(skeleton)
    references: dict[str, FloatArray] = {}
    frames = BodyFrames(np.ascontiguousarray(xyz.transpose(1, 2, 0)), skeleton, references)
    for bone in bones:
        mean = np.nanmean(frames.local_direction(bone), axis=1)
        references[bone] = mean / np.linalg.norm(mean)
    torso = [bone for bone in bones if body_frames.parent_bone(bone) is None]
    index, regions = [], []
    count = 0
    for bone in bones[len(torso) :]:
        parent = body_frames.parent_bone(bone)
        assert parent is not None
        rows, fitted = _regions(frames.local[parent], frames.local[bone], settings)
        index.append(rows + count)
        regions.append(fitted)
        count += len(fitted)
    table = np.concatenate(regions)
    return SeenDirections(
        skeleton,
        np.array([references[bone] for bone in bones]),
        np.array([_distance(frames.local[bone], settings) for bone in torso]),
        np.array(index, dtype=np.int32),
        table[:, :9].reshape(-1, 3, 3),
        table[:, 9:12],
        table[:, 12:],
        np.array([_takes_near(frames, bone, take, settings) for bone in bones]),
        settings,
    )


def widen(
    seen: SeenDirections, margins: Margins | None = None, metadata: dict[str, Any] | None = None
) -> Limits:
    """Limits that lie the given margins beyond what was observed."""
    margins = margins or Margins()
    angle = np.radians(margins.region_deg)
    low = np.arcsin(np.clip(seen.low, -1, 1)) - angle
    high = np.arcsin(np.clip(seen.high, -1, 1)) + angle
    high[:, 0] = np.pi / 2  # a half-space has one side
    # A side that the margin takes past the end of the sphere limits nothing.
    low = np.where(low <= -np.pi / 2, -2.0, np.sin(low))
    high = np.where(high >= np.pi / 2, 2.0, np.sin(high))
    return Limits(
        seen.skeleton,
        body_frames.limited_bones(seen.skeleton),
        seen.references,
        seen.distance_deg <= margins.occupancy_deg,
        seen.region,
        seen.axes.astype(np.float32),
        low.astype(np.float32),
        high.astype(np.float32),
        seen.takes,
        (metadata or {}) | {"settings": asdict(seen.settings) | asdict(margins)},
    )


def bin_centres() -> FloatArray:
    """Unit vectors (120, 60, 3) at the centres of the bins."""
    azimuth = np.radians((np.arange(AZIMUTHS) + 0.5) * BIN_DEGREES - 180)[:, None]
    elevation = np.radians((np.arange(ELEVATIONS) + 0.5) * BIN_DEGREES - 90)[None]
    flat = np.cos(elevation)
    centres: FloatArray = np.stack(
        np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)),
        axis=-1,
    )
    return centres


def _distance(direction: FloatArray, settings: ObservationSettings) -> FloatArray:
    """Angle (120, 60) in degrees from each bin's centre to the nearest of directions (3, N)."""
    tree = cKDTree(_thinned(direction.T, settings.spacing_deg))
    chord = tree.query(bin_centres().reshape(-1, 3))[0]
    degrees: FloatArray = np.degrees(2 * np.arcsin(chord / 2)).reshape(AZIMUTHS, ELEVATIONS)
    return degrees


def _takes_near(
    frames: BodyFrames, bone: str, take: IntArray, settings: ObservationSettings
) -> npt.NDArray[np.uint8]:
    """How many takes (120, 60), 255 at most, tell where the limit of a bone lies.

    Of a bone that leaves the torso, for each of its bins: takes that came as far as the seen
    direction closest to the bin. Of another, for each bin of its parent: takes whose parent came
    near the bin.
    """
    parent = body_frames.parent_bone(bone)
    direction = frames.local[parent or bone].T
    centres = bin_centres().reshape(-1, 3)
    if parent is None:
        seen = _thinned(direction, settings.spacing_deg)
        centres = seen[cKDTree(seen).query(centres)[1]]
    degrees = settings.parent_radius_deg if parent else settings.border_deg
    radius = 2 * np.sin(np.radians(degrees) / 2)
    count = np.zeros(len(centres), int)
    for number in np.unique(take):
        own = cKDTree(_thinned(direction[take == number], settings.spacing_deg))
        count += own.query(centres, distance_upper_bound=radius)[0] <= radius
    return np.minimum(count, 255).astype(np.uint8).reshape(AZIMUTHS, ELEVATIONS)


def _thinned(vectors: FloatArray, degrees: float) -> FloatArray:
    """One of the vectors for each cell of a grid about `degrees` wide."""
    cells = np.round(vectors / np.radians(degrees)).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    kept: FloatArray = vectors[first]
    return kept


def _regions(
    parent: FloatArray, child: FloatArray, settings: ObservationSettings
) -> tuple[FloatArray, FloatArray]:
    """The region row of every bin of the parent (120, 60), and the regions (R, 15)."""
    pairs = _thinned(np.concatenate([parent, child]).T, settings.spacing_deg)
    tree = cKDTree(pairs[:, :3])
    centres = bin_centres().reshape(-1, 3)
    radius = 2 * np.sin(np.radians(settings.parent_radius_deg) / 2)
    seen = np.flatnonzero(tree.query(centres)[0] <= radius)
    near = tree.query_ball_point(centres[seen], radius)
    closest = tree.query(centres[seen], k=min(settings.fewest, len(pairs)))[1]
    regions = np.array(
        [
            _fit(pairs[ball if len(ball) >= settings.fewest else closest[i], 3:], settings.trimmed)
            for i, ball in enumerate(near)
        ]
    )
    # A parent direction that no pose came near takes the region of the nearest that one did.
    rows = cKDTree(centres[seen]).query(centres)[1]
    return rows.reshape(AZIMUTHS, ELEVATIONS), regions


def _fit(directions: FloatArray, trimmed: float) -> FloatArray:
    """Half-space and box (axes, low, high as 15 numbers) around directions (n, 3)."""
    normal = directions.mean(axis=0)
    normal /= np.linalg.norm(normal)
    across = directions - np.outer(directions @ normal, normal)
    spread = np.linalg.eigh(across.T @ across)[1][:, -1]
    spread -= (spread @ normal) * normal
    spread /= np.linalg.norm(spread)
    axes = np.stack([normal, spread, np.cross(normal, spread)])
    low, high = np.quantile(directions @ axes.T, [trimmed, 1 - trimmed], axis=0)
    return np.concatenate([axes.ravel(), low, high])
