"""Where dancers stand in the recorded world.

Poses lifted from one camera are relative to the pelvis unless the lifter solved the path through
the room and put the floor at y = 0. Where it did not, the floor is put there for looking at them,
and dancers are set side by side. The poses themselves are not changed: the offset is kept apart
from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose.poses import Dancer, FloatArray, Unit

# Between pelvises set side by side: outstretched arms do not quite touch.
SPACING: dict[Unit, float] = {"body heights": 1.2, "metres": 2.0}
_PATHS = (
    "Dancers move along paths estimated for a camera that stands on one spot, over a floor "
    "levelled by upright bodies and standing feet (y = 0 is the lowest dancer's). What the camera "
    "turns and zooms is undone; where it is carried, the path is wrong by as much."
)


@dataclass(frozen=True)
class Placement:
    """Offsets of the dancers, and the sentences that tell a reader of them.

    offsets: (N, 3) in the poses' unit, to add to world positions, in the order of the dancers.
    """

    offsets: FloatArray
    notes: tuple[str, ...]


def place(dancers: Sequence[Dancer]) -> Placement:
    """Put the floor at y = 0, and dancers whose path is not known side by side."""
    if not dancers:
        return Placement(np.zeros((0, 3)), ())
    if all(d.smoothed.root is not None for d in dancers):
        return Placement(np.zeros((len(dancers), 3)), (_PATHS,))
    unit = dancers[0].smoothed.unit
    offsets = np.zeros((len(dancers), 3))
    offsets[:, 1] = -np.nan_to_num([floor_height(d.smoothed.world_xyz) for d in dancers])
    offsets[:, 0] = _side_by_side(dancers) * SPACING[unit]
    notes = [
        "The path through the room is not known: every pelvis stays in place, and its height "
        "above the floor is set once for the whole track."
    ]
    if len(dancers) > 1:
        notes.append(
            f"Dancers are set {SPACING[unit]:g} {unit} apart, in the order in which they are "
            "seen from left to right; the distance between them means nothing."
        )
    notes += [
        f"Dancer {d.person} is shown moved by x {x:+.3f}, y {y:+.3f}, z {z:+.3f} {unit}."
        for d, (x, y, z) in zip(dancers, offsets, strict=True)
    ]
    return Placement(offsets, tuple(notes))


def floor_height(xyz: FloatArray) -> float:
    """Height of the lowest joint over (T, J, 3), without the one or two wildest frames."""
    heights = xyz[..., 1]
    lowest = np.where(np.isnan(heights), np.inf, heights).min(axis=1)
    lowest = lowest[np.isfinite(lowest)]
    return float(np.percentile(lowest, 2)) if lowest.size else float("nan")


def _side_by_side(dancers: Sequence[Dancer]) -> FloatArray:
    """(N,) places along x, centred on 0: dancers seen at one time never share a place."""
    lanes: list[list[int]] = []
    for i in sorted(range(len(dancers)), key=lambda i: _span(dancers[i])):
        start = _span(dancers[i])[0]
        free = [lane for lane in lanes if _span(dancers[lane[-1]])[1] < start]
        if free:
            free[0].append(i)
        else:
            lanes.append([i])
    lanes.sort(key=lambda lane: float(np.mean([_image_x(dancers[i]) for i in lane])))
    places = np.zeros(len(dancers))
    for place_number, lane in enumerate(lanes):
        places[lane] = place_number - (len(lanes) - 1) / 2
    return places


def _span(dancer: Dancer) -> tuple[int, int]:
    frames = dancer.keypoints.frame
    return (int(frames[0]), int(frames[-1])) if len(frames) else (0, -1)


def _image_x(dancer: Dancer) -> float:
    seen = dancer.keypoints.xy[..., 0]
    seen = seen[~np.isnan(seen)]
    return float(seen.mean()) if seen.size else 0.0
